"""`python -m ghal360_robot`: the same as the `ghal360` command."""

from ghal360_robot.cli.main import main

if __name__ == "__main__":
    main()
