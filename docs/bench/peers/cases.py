# SPDX-License-Identifier: GPL-3.0-or-later
"""What `bench --peers` renders: scenes × maps × methods, as plain data that every part of it imports."""

from __future__ import annotations

from dataclasses import dataclass, field

WIDTH, HEIGHT = 128, 96
SAMPLES = (1, 4, 16, 64)  # squares, so that multijittered points are whole grids
TIMED = (4, 64)  # time of a sample: the difference of these two renders
SEEDS = (0, 1, 2, 3)  # one a round

MAPS = ("city", "courtyard", "interior", "night", "studio", "sunset")  # come with Blender, CC0
SCENES = {
    "spheres": "Diffuse BSDF, Glossy GGX 0.2 and 0.5 on a grey ground",
    "suzanne": "the monkey, image texture on Diffuse, 20 % Glossy GGX 0.35, on a grey ground",
    "teapot": "the teapot in chrome, Glossy GGX 0.1, on a grey ground",
    "aniso": "a sphere, Glossy GGX 0.35 with anisotropy 0.7, on a grey ground",
    "room": "a closed room, lit through one window of 1.4 m × 1.1 m",
}


@dataclass(frozen=True)
class Case:
    scene: str
    map: str
    bounces: int = 0

    @property
    def key(self) -> str:
        return f"{self.scene}-{self.map}-{self.bounces}"


@dataclass(frozen=True)
class Method:
    """engine: SKYTREE, CYCLES or MITSUBA; preset: of Skytree's render settings, and settings over it;
    sampler: Mitsuba's."""

    engine: str
    preset: str = ""
    sampler: str = ""
    settings: dict = field(default_factory=dict)


METHODS = {
    "Skytree, best": Method("SKYTREE", preset="BEST"),
    "Skytree, best, even": Method("SKYTREE", preset="BEST", settings={"adaptive_sampling": False}),
    "Skytree, paper": Method("SKYTREE", preset="PAPER"),
    "Cycles": Method("CYCLES"),
    "Mitsuba, independent": Method("MITSUBA", sampler="independent"),
    "Mitsuba, multijitter": Method("MITSUBA", sampler="multijitter"),
}
PEERS = ("Cycles", "Mitsuba, independent", "Mitsuba, multijitter")

# Each engine's own reference: the method that renders it and the parts of each of two halves, as
# (samples, renders). Their own squared error is subtracted, so they need not be free of noise.
REFERENCES = {
    "SKYTREE": ("Skytree, best", 256, 1),
    "CYCLES": ("Cycles", 128, 1),
    "MITSUBA": ("Mitsuba, multijitter", 256, 2),
}


def all_cases() -> list[Case]:
    """Map by map, so that a run that ends early has seen all scenes."""
    bounced = [
        Case(scene, name, 4) for name in ("city", "courtyard", "interior") for scene in ("room", "suzanne")
    ]
    cases = []
    for map_name in MAPS:
        cases += [Case(scene, map_name) for scene in SCENES] + bounced[:1]
        del bounced[:1]
    return cases


def quick_cases() -> list[Case]:
    """Two scenes under two maps: enough to see that everything works."""
    return [Case(scene, name) for scene in ("spheres", "suzanne") for name in ("city", "interior")]
