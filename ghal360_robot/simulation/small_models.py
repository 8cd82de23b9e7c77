"""What hangs on walls or stands about: screens, lamps, paper, books, rugs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ghal360_robot.simulation.materials import CHROME, DARK, INK, OAK, WALNUT, pick, timber
from ghal360_robot.simulation.meshes import Colour, Frame, Surface

if TYPE_CHECKING:
    from numpy.random import Generator

    from ghal360_robot.simulation.objects import WorldObject


def panel_picture(f: Frame, o: WorldObject, rng: Generator) -> None:
    w, d, h = o.size
    frame = timber(pick(rng, (WALNUT, OAK, (0.14, 0.14, 0.14))), 0.3)
    names = ("painting 0", "painting 1", "painting 2", "scenery")
    f.box(0, 0, 0, (w, d, h), frame, skip=("back",))
    f.box(
        0,
        -d / 2 - 0.005,
        0.025,
        (w - 0.05, 0.002, h - 0.05),
        frame,
        front=Surface(names[int(rng.integers(4))]),
        skip=("back",),
    )


def whiteboard(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.box(0, 0, 0, (w, d, h), CHROME, skip=("back",))
    f.box(0, -d / 2 - 0.006, 0.03, (w - 0.06, 0.002, h - 0.06), CHROME, front=Surface("whiteboard"), skip=("back",))
    f.box(0, -d / 2 - 0.03, 0.0, (w * 0.5, 0.06, 0.015), CHROME, skip=())


def wall_clock(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r = o.size[0] / 2
    face = f.at(0, o.size[1] / 2 - 0.005, r, pitch=-math.pi / 2)
    face.tube(0, 0, 0, [(r, 0.0), (r, 0.035), (r * 0.9, 0.04)], DARK, sides=20)
    s = r * 0.64
    f.quad([(-s, -0.02, r - s), (s, -0.02, r - s), (s, -0.02, r + s), (-s, -0.02, r + s)], Surface("clock"))
    face.tube(0, 0, 0.035, [(r * 0.92, 0.0), (0.0, 0.001)], Surface("plain", (0.96, 0.96, 0.95)), sides=20)


def mirror(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.box(0, 0, 0, (w, d, h), timber(OAK, 0.4), skip=("back",))
    f.box(
        0,
        -d / 2 - 0.006,
        0.03,
        (w - 0.06, 0.002, h - 0.06),
        DARK,
        front=Surface("steel", (0.82, 0.86, 0.88)),
        skip=("back",),
    )


def monitor(f: Frame, o: WorldObject, rng: Generator) -> None:
    w, _d, h = o.size
    f.box(0, 0.02, 0, (0.22, 0.16, 0.012), INK)
    f.box(0, 0.05, 0, (0.05, 0.03, 0.26), INK)
    screen = Surface(f"desktop {int(rng.integers(2))}", glows=True)
    f.box(0, 0.0, h - 0.35, (w, 0.035, 0.35), INK, skip=())
    f.box(0, -0.019, h - 0.337, (w - 0.024, 0.002, 0.324), INK, front=screen, skip=("back",))


def keyboard(f: Frame, o: WorldObject, _rng: Generator) -> None:
    f.box(0, 0, 0, o.size, DARK, top=Surface("keys"))
    f.blob(o.size[0] / 2 + 0.09, 0, 0, (0.03, 0.05, 0.015), DARK)


def paper_tray(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, _h = o.size
    for z in (0.0, 0.075):
        f.box(0, 0, z, (w, d, 0.008), Surface("plain", (0.35, 0.36, 0.37)), skip=())
        f.box(0.005, 0, z + 0.008, (w - 0.04, d - 0.03, 0.022), Surface("plain", (0.95, 0.95, 0.94)))
    for x in (-1.0, 1.0):
        f.box(x * (w / 2 - 0.005), d / 2 - 0.03, 0, (0.01, 0.05, 0.12), DARK, skip=())


def divider(f: Frame, o: WorldObject, _rng: Generator) -> None:
    f.box(0, 0, 0, o.size, Surface("fabric", (0.50, 0.55, 0.54), 0.3), skip=())


def waste_bin(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    f.tube(0, 0, 0, [(r * 0.78, 0.0), (r, h), (r * 0.92, h), (r * 0.75, 0.04), (0.0, 0.03)], DARK, sides=14)


def coat_rack(f: Frame, o: WorldObject, rng: Generator) -> None:
    h = o.size[2]
    f.tube(
        0, 0, 0, [(0.19, 0.0), (0.18, 0.03), (0.025, 0.05), (0.022, h), (0.0, h + 0.02)], timber(WALNUT, 0.3), sides=12
    )
    coats: tuple[Colour, ...] = ((0.30, 0.31, 0.36), (0.50, 0.47, 0.43), (0.36, 0.41, 0.37))
    for hook in range(5):
        turned = f.at(yaw=hook * math.tau / 5)
        turned.at(0, -0.02, h - 0.12, pitch=0.8).box(0, 0, 0, (0.02, 0.02, 0.14), timber(WALNUT, 0.3), skip=())
        if hook < 3:
            cloth = Surface("fabric", coats[hook], 0.3)
            turned.blob(0, -0.13, h - 0.95 + 0.1 * float(rng.random()), (0.14, 0.07, 0.42), cloth, power=0.6)


def floor_lamp(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    f.tube(0, 0, 0, [(r * 0.9, 0.0), (r * 0.85, 0.025), (0.015, 0.035), (0.013, h - 0.2)], CHROME, sides=14)
    _lampshade(f, h - 0.34, r, 0.32)


def table_lamp(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    f.tube(
        0, 0, 0, [(r * 0.5, 0.0), (r * 0.55, 0.05), (r * 0.2, 0.12), (0.015, 0.2)], Surface("stone", (0.8, 0.8, 0.8))
    )
    _lampshade(f, h - 0.22, r, 0.22)


def _lampshade(f: Frame, z: float, r: float, tall: float) -> None:
    outside = Surface("fabric", (0.99, 0.95, 0.87), 0.2, glows=True)
    f.tube(0, 0, z, [(r, 0.0), (r * 0.72, tall)], outside, sides=16)
    f.tube(0, 0, z, [(r * 0.7, tall - 0.01), (r * 0.98, 0.0)], Surface("plain", (1.0, 0.97, 0.9), glows=True), sides=16)


def book_pile(f: Frame, o: WorldObject, rng: Generator) -> None:
    z = 0.0
    cover: tuple[Colour, ...] = ((0.34, 0.37, 0.42), (0.55, 0.50, 0.44), (0.40, 0.46, 0.41), (0.75, 0.74, 0.72))
    for index in range(4):
        tall, skew = 0.025 + 0.012 * float(rng.random()), float(rng.uniform(-0.25, 0.25))
        w, d = o.size[0] - 0.03 * float(rng.random()), o.size[1] - 0.02 * float(rng.random())
        pile = f.at(z=z, yaw=skew)
        pile.box(0, 0, 0, (w, d, tall), Surface("plain", cover[index]), skip=())
        pile.box(0, -d / 2 - 0.0005, 0.004, (w - 0.01, 0.001, tall - 0.008), Surface("plain", (0.92, 0.91, 0.87)))
        z += tall


def fruit_bowl(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r = o.size[0] / 2
    f.tube(
        0,
        0,
        0,
        [(r * 0.4, 0.0), (r, 0.09), (r * 0.95, 0.09), (0.0, 0.03)],
        Surface("plain", (0.88, 0.88, 0.87)),
        sides=18,
    )
    for index in range(5):
        a = index * math.tau / 5
        f.blob(0.07 * math.cos(a), 0.07 * math.sin(a), 0.05, (0.04, 0.04, 0.038), Surface("plain", (0.55, 0.64, 0.43)))


def mug(f: Frame, o: WorldObject, rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    glaze = Surface("plain", pick(rng, ((0.92, 0.92, 0.91), (0.42, 0.46, 0.48), (0.60, 0.62, 0.56))))
    f.tube(0, 0, 0, [(r * 0.9, 0.0), (r, h), (r * 0.9, h), (r * 0.85, 0.01), (0.0, 0.01)], glaze, sides=12)
    f.box(r + 0.015, 0, h * 0.2, (0.03, 0.012, h * 0.6), glaze, skip=())


def flat_rug(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.sheet((-w / 2, -d / 2, h), (w, 0, 0), (0, d, 0), Surface("rug", (1.0, 1.0, 1.0)), steps=(6, 4), whole=True)
