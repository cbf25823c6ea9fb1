# SPDX-License-Identifier: GPL-3.0-or-later
"""From what was measured of each case to efficiencies, errors at equal time and the check of the means."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass

from cases import HEIGHT, METHODS, PEERS, SAMPLES, TIMED, WIDTH, Case

JUDGED = (4, 16, 64)  # samples per pixel at which efficiencies are told
MEANS_DIFFER = 0.003  # of a mean; larger differences are shown as such where noise does not explain them
NOISE = 4.0  # standard errors


@dataclass
class Result:
    """One case as measuring.measure tells it."""

    case: Case
    references: dict
    methods: dict

    @classmethod
    def read(cls, measured: dict) -> Result:
        """Also from JSON, whose keys are texts."""
        methods = {
            name: {kind: {int(n): v for n, v in by.items()} for kind, by in values.items()}
            for name, values in measured["methods"].items()
        }
        return cls(Case(**measured["case"]), measured["references"], methods)

    def microseconds(self, method: str) -> float:
        """Processor time of a pixel sample: median over the rounds of the difference of two renders."""
        few, many = (self.methods[method]["cpu_seconds"][n] for n in TIMED)
        per_sample = [
            (b - a) / ((TIMED[1] - TIMED[0]) * WIDTH * HEIGHT) for a, b in zip(few, many, strict=True)
        ]
        return 1e6 * statistics.median(per_sample)

    def values(self, method: str, samples: int, figure: str = "nrmse_tc") -> list[float]:
        return [f[figure] for f in self.methods[method]["figures"][samples]]

    def error(self, method: str, samples: int, figure: str = "nrmse_tc") -> float:
        """Mean of the rounds. nRMSE_tc is 0 where it is below what the reference can tell: then it counts as
        falling like 1/n since the sample count before, faster than any of these methods converges."""
        found = statistics.mean(self.values(method, samples, figure))
        if figure != "nrmse_tc" or samples == SAMPLES[0]:
            return found
        before = SAMPLES[SAMPLES.index(samples) - 1]
        return max(found, self.error(method, before) * before / samples)

    def spread(self, method: str, samples: int, figure: str = "nrmse_tc") -> float:
        return statistics.stdev(self.values(method, samples, figure))

    def efficiency(self, method: str, samples: int) -> float:
        """1 / (nRMSE_tc² × processor time of a pixel), per microsecond."""
        return 1 / (self.error(method, samples) ** 2 * samples * self.microseconds(method))

    def best_peer(self, samples: int) -> str:
        return max(PEERS, key=lambda peer: self.efficiency(peer, samples))

    def over_best_peer(self, method: str, samples: int) -> float:
        return self.efficiency(method, samples) / self.efficiency(self.best_peer(samples), samples)

    def over_cycles(self, method: str, samples: int) -> float:
        return self.efficiency(method, samples) / self.efficiency("Cycles", samples)

    def error_at_time(self, method: str, microseconds: float) -> tuple[float, bool]:
        """nRMSE_tc after that processor time per pixel, and whether it is interpolated, not extrapolated.

        Linear in the logarithms of time and error, between the sample counts that were rendered.
        """
        per_sample = self.microseconds(method)
        points = [(math.log(n * per_sample), math.log(self.error(method, n))) for n in SAMPLES]
        wanted = math.log(microseconds)
        inside = points[0][0] - 1e-6 <= wanted <= points[-1][0] + 1e-6
        after = next((i for i in range(1, len(points)) if wanted <= points[i][0]), len(points) - 1)
        (t0, e0), (t1, e1) = points[after - 1], points[after]
        return math.exp(e0 + (e1 - e0) * (wanted - t0) / (t1 - t0)), inside

    def common_time(self) -> float:
        """Microseconds per pixel that Mitsuba with multijitter takes for 16 samples."""
        return 16 * self.microseconds("Mitsuba, multijitter")

    def mean_differences(self) -> dict[str, tuple[float, float]]:
        """(relative difference of the references' means, its standard error) of pairs of engines."""
        found = {}
        for a, b in (("SKYTREE", "CYCLES"), ("SKYTREE", "MITSUBA"), ("MITSUBA", "CYCLES")):
            first, second = self.references[a], self.references[b]
            noise = math.hypot(first["standard_error"], second["standard_error"]) / second["mean"]
            found[f"{a}/{b}"] = (first["mean"] / second["mean"] - 1, noise)
        return found


def disagrees(difference: float, noise: float) -> bool:
    return abs(difference) > MEANS_DIFFER and abs(difference) > NOISE * noise


def geometric_mean(values: list[float]) -> float:
    return math.exp(statistics.mean(math.log(max(v, 1e-12)) for v in values))


@dataclass(frozen=True)
class Promise:
    text: str
    bound: float
    ratios: dict[int, list[float]]  # by samples per pixel, one a case
    worst: bool  # of the cases, or their median

    def found(self, samples: int) -> float:
        return (min if self.worst else statistics.median)(self.ratios[samples])

    @property
    def kept(self) -> bool:
        return all(self.found(n) >= self.bound for n in self.ratios)


def promises(results: list[Result], method: str = "Skytree, best") -> list[Promise]:
    """What Skytree is meant to reach, and what these cases say."""
    direct = [r for r in results if r.case.bounces == 0]
    room = [r for r in direct if r.case.scene == "room"]
    bounced = [r for r in results if r.case.bounces > 0]

    def peers(chosen: list[Result]) -> dict:
        return {n: [r.over_best_peer(method, n) for r in chosen] for n in JUDGED}

    def cycles(chosen: list[Result]) -> dict:
        return {n: [r.over_cycles(method, n) for r in chosen] for n in JUDGED}

    made = []
    if direct:
        made += [
            Promise("direct light, over the best peer of each case: median", 5, peers(direct), False),
            Promise("direct light, over the best peer of each case: worst case", 1, peers(direct), True),
            Promise("direct light, over Cycles: median", 25, cycles(direct), False),
        ]
    if room:
        made.append(Promise("the room, over Cycles: median", 4, cycles(room), False))
    if bounced:
        made.append(Promise("4 bounces, over Cycles: median", 4, cycles(bounced), False))
    return made


def rows(results: list[Result]) -> list[dict]:
    """The CSV: a row for each case, method and sample count."""
    return [
        {
            **{"scene": r.case.scene, "map": r.case.map, "bounces": r.case.bounces},
            **{"method": method, "samples": n, "microseconds_per_sample": r.microseconds(method)},
            **{figure: r.error(method, n, figure) for figure in ("nrmse_tc", "relmse_tc", "flip")},
            **{f"{figure}_sd": r.spread(method, n, figure) for figure in ("nrmse_tc", "relmse_tc", "flip")},
            "efficiency": r.efficiency(method, n),
            "mean_difference": r.error(method, n, "mean_difference"),
        }
        for r in results
        for method in METHODS
        for n in SAMPLES
    ]
