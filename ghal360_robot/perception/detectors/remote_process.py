"""The process in which `remote` runs a network: orders and answers over a socket, pictures in shared memory."""

from __future__ import annotations

import mmap
import os
import signal
import sys
from multiprocessing.connection import Connection

import cv2
import numpy as np

from ghal360_robot.errors import GhalError
from ghal360_robot.perception.detectors.base import Detector, make_detector
from ghal360_robot.perception.detectors.errors import DetectorError
from ghal360_robot.perception.detectors.remote import Order, Ready, Search

NICENESS = 5
"""Searching waits when the control loop wants the processor."""


def serve(link: Connection, memory: memoryview) -> None:
    """Load what is ordered and search until the socket closes."""
    order: Order = link.recv()
    cv2.setNumThreads(max(1, order.options.threads))
    try:
        detector = make_detector(order.name, order.options)
    except GhalError as error:
        link.send(error)
        return
    link.send(Ready(detector.name, detector.class_names))
    while True:
        link.send(_answer(detector, link.recv(), memory))


def _answer(detector: Detector, search: Search, memory: memoryview) -> object:
    try:
        if not search.height:
            detector.warm_up()
            return ()
        shape = search.height, search.width, 3
        picture = np.frombuffer(memory, np.uint8, search.height * search.width * 3).reshape(shape)
        return detector.detect(picture)
    except GhalError as error:
        return error
    except Exception as error:  # noqa: BLE001 - it goes to the robot, which counts and says it
        # A network is foreign code, and not every exception can be sent.
        return DetectorError(f"{type(error).__name__}: {error}")


def main() -> None:
    """Entry of the process: `remote_process SOCKET MEMORY`, two descriptors."""
    link, memory = Connection(int(sys.argv[1])), mmap.mmap(int(sys.argv[2]), 0, prot=mmap.PROT_READ)
    os.nice(NICENESS)
    # Signals are for the robot; this process ends when its socket closes.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    try:
        serve(link, memoryview(memory))
    except (EOFError, ConnectionError):
        sys.exit(0)


if __name__ == "__main__":
    main()
