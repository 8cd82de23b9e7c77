"""The live view's server, a process of its own: batches come in by a pipe, viewers connect by gRPC or a browser.

Whatever happens in here, the robot goes on: it never waits for this process, and the kernel, short of memory,
kills this one first.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr
import rerun_cli  # type: ignore[import-untyped]

from ghal360_robot.logbook.blueprint import operator_blueprint
from ghal360_robot.logbook.clock import Anchor
from ghal360_robot.logbook.encoding import chunk, from_bytes
from ghal360_robot.logbook.live_feed import LENGTH, SAYS
from ghal360_robot.logbook.settings import LiveSettings
from ghal360_robot.logbook.statics import APPLICATION_ID, Mount, Run, log_statics

if TYPE_CHECKING:
    from collections.abc import Iterator

# Of two programs that want the same core, the control loop is the other one.
NICENESS = 10
MEMORY_CHECK_S = 1.0
PR_SET_PDEATHSIG = 1
EVERYWHERE = ("0.0.0.0", "::")  # noqa: S104 - compared with, not bound to


def main() -> int:
    _be_modest()
    pipe = sys.stdin.buffer
    hello = json.loads(next(_frames(pipe)))
    settings, run = LiveSettings(**hello["settings"]), _run(hello["run"])
    threading.Thread(target=_watch_memory, args=(settings.memory_bytes,), daemon=True).start()
    taken = _port_taken(settings.host, settings.port)
    if taken:
        _say(f"{settings.host}:{settings.port} cannot be listened on ({taken}); choose another port")
        return 1
    stream = _serve(settings, run)
    uri = f"rerun+http://{_name(settings.host)}:{settings.port}/proxy"
    web = None if settings.web_port is None else _serve_web(settings.host, settings.web_port, uri)
    page = "" if settings.web_port is None else f", in a browser http://{_name(settings.host)}:{settings.web_port}"
    _say(f"rerun --connect {uri}{page}")
    for frame in _frames(pipe):
        try:
            stream.send_chunks(chunk(from_bytes(frame)))
        except (pa.ArrowException, ValueError, OSError) as error:
            _say(f"a batch was not taken ({error})")
    if web is not None:
        web.kill()
    return 0


def _serve(settings: LiveSettings, run: Run) -> rr.RecordingStream:
    stream = rr.RecordingStream(APPLICATION_ID, recording_id=run.run_id, send_properties=False)
    origins = [] if settings.web_port is None else [f"http://*:{settings.web_port}"]
    sink = rr.GrpcServerSink(
        bind_ip=settings.host,
        port=settings.port,
        server_memory_limit=f"{settings.history_bytes >> 20}MiB",
        cors_allow_origin=origins,
    )
    stream.set_sinks(sink, default_blueprint=operator_blueprint())
    log_statics(stream, run)
    return stream


def _serve_web(host: str, port: int, uri: str) -> subprocess.Popen[bytes] | None:
    """Rerun's own web viewer; its Python function listens on every interface, its command line on one."""
    taken = _port_taken(host, port)
    if taken:
        _say(f"{host}:{port} cannot be listened on ({taken}): no viewer for browsers")
        return None
    program = str(Path(rerun_cli.__file__).parent / "rerun")
    command = [program, "--serve-web", "--bind", host, "--web-viewer-port", str(port), uri]
    return subprocess.Popen(  # noqa: S603 - Rerun's own command line
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        preexec_fn=_die_with_parent,  # noqa: PLW1509 - one system call, and there are no locks of ours to hold
    )


def _frames(pipe: BinaryIO) -> Iterator[bytes]:
    """Until the robot closes its end."""
    while len(header := pipe.read(LENGTH.size)) == LENGTH.size:
        (length,) = LENGTH.unpack(header)
        data = pipe.read(length)
        if len(data) < length:
            return
        yield data


def _run(told: dict[str, Any]) -> Run:
    mounts = {name: Mount(**mount) for name, mount in told.pop("mounts").items()}
    return Run(anchor=Anchor(**told.pop("anchor")), mounts=mounts, **told)


def _name(host: str) -> str:
    return socket.gethostname() if host in EVERYWHERE else host


def _port_taken(host: str, port: int) -> str:
    """Why nothing can listen there; Rerun would only log it (fact sheet rerun_and_style, A6)."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind((host, port))
    except OSError as error:
        return error.strerror or str(error)
    return ""


def _be_modest() -> None:
    """After the control loop in everything: processor, memory, life."""
    os.nice(NICENESS)
    _die_with_parent()
    try:
        Path("/proc/self/oom_score_adj").write_text("1000")
    except OSError:
        _say("the kernel does not let itself be told whom to kill first")


def _die_with_parent() -> None:
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _watch_memory(limit: int) -> None:
    page = os.sysconf("SC_PAGE_SIZE")
    while True:
        resident = int(Path("/proc/self/statm").read_text().split()[1]) * page
        if resident > limit:
            _say(f"a viewer is too slow: {resident >> 20} MiB wait for it")
            os._exit(1)
        time.sleep(MEMORY_CHECK_S)


def _say(sentence: str) -> None:
    os.write(1, f"{SAYS}{sentence}\n".encode())


if __name__ == "__main__":
    code = main()
    # Rerun's own way out waits for viewers that may be frozen.
    os._exit(code)
