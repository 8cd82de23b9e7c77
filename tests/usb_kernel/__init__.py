"""The camera's driver on a real Linux kernel, in a virtual machine: `make test-usb`."""
