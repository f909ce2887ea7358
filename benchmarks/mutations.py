"""Does the suite notice a wrong formula? One small mistake at a time, on a copy.

    python benchmarks/mutations.py             # the test files named with each mistake
    python benchmarks/mutations.py --whole     # and for survivors the rest of the suite
    python benchmarks/mutations.py sway lens   # only mistakes with such a word

For each mistake the tree is copied to a temporary folder, one text of one file is
replaced, and pytest runs there until its first failure. The tests named are run
unchanged before, since a test that fails anyway notices nothing. Exit code: 1 where a
mistake survives, 2 where a text is no longer in the code.
"""

import argparse
import dataclasses
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
LEFT_OUT = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "site")


@dataclasses.dataclass(frozen=True)
class Mutation:
    """One mistake.

    Attributes:
        name: what is wrong with it, in words.
        file: path from the root of the project.
        old: text that stands in the file exactly once.
        new: text put in its place.
        tests: words of pytest, the file likeliest to notice first.
    """

    name: str
    file: str
    old: str
    new: str
    tests: str

    def apply(self, root: Path) -> None:
        """Write the mistake into a copy of the tree."""
        path = root / self.file
        path.write_text(path.read_text("utf-8").replace(self.old, self.new), "utf-8")


def _in(file: str, *mistakes: tuple[str, str, str, str]) -> list[Mutation]:
    return [Mutation(name, file, old, new, tests) for name, old, new, tests in mistakes]


MUTATIONS = [
    *_in(
        "jaxglider/control/prescribed/performance.py",
        (
            "performance: final bound dropped",
            "live.value + function.final_bound",
            "live.value",
            "test_performance.py",
        ),
        (
            "performance: sign in P'' of sech",
            "tanh * tanh - sech * sech",
            "tanh * tanh + sech * sech",
            "test_performance.py",
        ),
        (
            "performance: sign in P' of exp",
            "(-1.0 / duration - height * z.rate)",
            "(1.0 / duration - height * z.rate)",
            "test_performance.py",
        ),
    ),
    *_in(
        "jaxglider/control/prescribed/transform.py",
        (
            "transform: factor 2 of x'P' dropped",
            "(2.0 * x1 * width1 + x * width2)",
            "(x1 * width1 + x * width2)",
            "test_transform.py",
        ),
        (
            "transform: edges swapped in the clip",
            "-self.tail * self.lower, self.tail * self.upper",
            "-self.tail * self.upper, self.tail * self.lower",
            "test_transform.py",
        ),
        (
            "transform: sign in d/dt 1/lambda",
            "width1 * flat - width * curve",
            "width1 * flat + width * curve",
            "test_transform.py",
        ),
    ),
    *_in(
        "jaxglider/control/smc.py",
        (
            "smc: gains swapped",
            "- c0 * e1 - c1 * p",
            "- c1 * e1 - c0 * p",
            "test_controllers.py",
        ),
        (
            "smc: sign of the surface",
            "e1 + c0 * e,",
            "e1 - c0 * e,",
            "test_controllers.py",
        ),
    ),
    *_in(
        "jaxglider/control/ppc.py",
        (
            "ppc: sign of the margin",
            "0.0) + margin)",
            "0.0) - margin)",
            "test_controllers.py",
        ),
        (
            "ppc: value and rate swapped in the surface",
            "t.rate + l0 * t.value",
            "t.value + l0 * t.rate",
            "test_controllers.py",
        ),
    ),
    *_in(
        "jaxglider/control/fxtppc.py",
        (
            "fxtppc: a factor in the paper's last exponent",
            "rho), (over / (2.0 - rho), over / (3.0 - 2.0 * rho))",
            "rho), (over / (2.0 - rho), over / (3.0 - rho))",
            "test_controllers.py",
        ),
        (
            "fxtppc: linear term of the reaching law dropped",
            "s * (power + 1.0 + 1.0 / power)",
            "s * (power + 1.0 / power)",
            "test_controllers.py",
        ),
        (
            "fxtppc: sign of the integral",
            "integral + dt * c.sliding",
            "integral - dt * c.sliding",
            "test_controllers.py",
        ),
        (
            "fxtppc: kappa dropped",
            "(t.offset + c.sliding + c.reaching)",
            "(c.sliding + c.reaching)",
            "test_controllers.py",
        ),
    ),
    *_in(
        "jaxglider/control/fxtppc_roll.py",
        (
            "fxtppc-roll: sign of the damping",
            "self.largest_angle) - self.roll_damping",
            "self.largest_angle) + self.roll_damping",
            "test_controllers.py",
        ),
        (
            "fxtppc-roll: sign of the hedge",
            "integral - dt * self.hedging",
            "integral + dt * self.hedging",
            "test_controllers.py",
        ),
    ),
    *_in(
        "jaxglider/control/observer.py",
        (
            "observer: sign of the estimate in the mismatch",
            "- dt * (f + d)",
            "- dt * (f - d)",
            "test_observer.py",
        ),
        (
            "observer: factor of the quadratic term",
            "2.0 * stretch + 1.5 * stretch * stretch * size",
            "2.0 * stretch + 0.5 * stretch * stretch * size",
            "test_observer.py",
        ),
        (
            "observer: sign in the slope of the implicit equation",
            "(0.5 * (far1 - near1) + far2 - near2)",
            "(0.5 * (far1 + near1) + far2 - near2)",
            "test_numerics.py",
        ),
    ),
    *_in(
        "jaxglider/vehicle/design_model.py",
        (
            "design model: a term dropped in the normal equations",
            "g00 * r0 + g10 * r1 + g20 * r2",
            "g00 * r0 + g10 * r1",
            "test_design_model.py",
        ),
    ),
    *_in(
        "jaxglider/vehicle/moving_mass.py",
        (
            "moving mass: sign in the cross product",
            "y * down - z * side",
            "y * down + z * side",
            "test_physics.py",
        ),
        (
            "moving mass: printed row 4 has the other sign",
            "row4_sign=-1.0",
            "row4_sign=1.0",
            "test_physics.py",
        ),
        (
            "moving mass: factor in the series of the sine",
            "gamma2 / 6.0",
            "gamma2 / 2.0",
            "test_physics.py",
        ),
        (
            "moving mass: righting moment with the cosine of roll",
            "-weight_arm * a.cos_pitch * a.sin_roll",
            "-weight_arm * a.cos_pitch * a.cos_roll",
            "test_physics.py",
        ),
    ),
    *_in(
        "jaxglider/vehicle/hydrodynamics.py",
        (
            "coriolis: indices swapped in the Munk moment",
            "(m3 - m1) * u * w",
            "(m1 - m3) * u * w",
            "test_physics.py",
        ),
        (
            "hydrodynamics: roll damped by the pitch rate",
            "c.roll_damping * p * squared",
            "c.roll_damping * q * squared",
            "test_physics.py",
        ),
        (
            "flow frame: sign of lift along the body",
            "cos_a * level - sin_a * z",
            "cos_a * level + sin_a * z",
            "test_full_plant.py",
        ),
    ),
    *_in(
        "jaxglider/vehicle/full_plant.py",
        (
            "full plant: a term of the transport dropped",
            "k2 * r - k3 * q + p2 * w - p3 * v",
            "k2 * r - k3 * q + p2 * w",
            "test_full_plant.py",
        ),
        (
            "full plant: index in the coupled inertia",
            "m.j11 - m.c01 * m.c01 * d1 - m.c21 * m.c21 * d3",
            "m.j11 - m.c01 * m.c01 * d1 - m.c21 * m.c21 * d2",
            "test_full_plant.py",
        ),
    ),
    *_in(
        "jaxglider/core/rotations.py",
        (
            "rotations: sign in the pitch rate",
            "a.cos_roll * pitch_rate - a.sin_roll * yaw_rate",
            "a.cos_roll * pitch_rate + a.sin_roll * yaw_rate",
            "test_frames.py",
        ),
    ),
    *_in(
        "jaxglider/vehicle/actuators.py",
        (
            "actuators: sign of the lag",
            "held - jnp.expm1(-dt / self.time_constant)",
            "held + jnp.expm1(-dt / self.time_constant)",
            "test_actuators.py",
        ),
    ),
    *_in(
        "jaxglider/simulation/closed_loop.py",
        (
            "closed loop: observer told the command before",
            "carry.observer, measurement, applied, observed, self",
            "carry.observer, measurement, carry.held, observed, self",
            "test_rollout.py",
        ),
    ),
    *_in(
        "jaxglider/simulation/motion.py",
        (
            "motion: force frozen within a substep",
            "share = (number + node) / substeps",
            "share = number / substeps + 0.0 * node",
            "test_rollout.py",
        ),
    ),
    *_in(
        "jaxglider/simulation/metrics.py",
        (
            "metrics: first command counts as a change",
            "jnp.where(first, 0.0, u - h) ** 2",
            "(u - h) ** 2",
            "test_metrics.py",
        ),
        (
            "metrics: crowding not averaged",
            "s.crowding / n",
            "s.crowding",
            "test_metrics.py",
        ),
        (
            "metrics: wanted for applied in the excess",
            "/ (u * u + (w - u) ** 2",
            "/ (w * w + (w - u) ** 2",
            "test_metrics.py",
        ),
    ),
    *_in(
        "jaxglider/guidance/line_of_sight.py",
        (
            "line of sight: integral left out of the aim's rate",
            "aim_rate = cross_track_rate + self.integral_gain * integral_rate",
            "aim_rate = cross_track_rate",
            "test_references.py",
        ),
        (
            "line of sight: sign of the heading",
            "-arctan(aim / length)",
            "arctan(aim / length)",
            "test_references.py",
        ),
    ),
    *_in(
        "jaxglider/guidance/schedule.py",
        (
            "schedule: start depth dropped",
            "self.initial_depth + jnp.cumsum(",
            "0.0 * self.initial_depth + jnp.cumsum(",
            "test_references.py",
        ),
    ),
    *_in(
        "jaxglider/guidance/waypoints.py",
        (
            "waypoints: integral kept at a switch",
            "jnp.where(switch, 0.0, state.integral)",
            "jnp.where(switch, state.integral, state.integral)",
            "test_references.py",
        ),
    ),
    *_in(
        "jaxglider/environment/disturbances.py",
        (
            "sinusoid: sign of the phase",
            "(a * in_phase) * sine + (a * ahead) * cosine",
            "(a * in_phase) * sine - (a * ahead) * cosine",
            "test_disturbances.py",
        ),
        (
            "noise: factor in its variance",
            "jnp.expm1(-2.0 * dt / tau)",
            "jnp.expm1(-dt / tau)",
            "test_disturbances.py",
        ),
        (
            "varied sea: roll moment turned the other way",
            "along * f.roll - across * f.pitch",
            "along * f.roll + across * f.pitch",
            "test_disturbances.py",
        ),
    ),
    *_in(
        "jaxglider/environment/water.py",
        (
            "water: sign in the turning frame",
            "aside - (r * x - p * z)",
            "aside - (r * x + p * z)",
            "test_water.py",
        ),
        (
            "water: density and hull swapped",
            "(squeezed - dense + dense * squeezed)",
            "(dense - squeezed + dense * squeezed)",
            "test_water.py",
        ),
    ),
    *_in(
        "jaxglider/uncertainty/distributions.py",
        (
            "distributions: one tail cut only",
            "(1.0 - 2.0 * tail)",
            "(1.0 - tail)",
            "test_distributions.py",
        ),
        (
            "distributions: copula mixes the wrong column",
            "weight * scores[:, j]",
            "weight * scores[:, i - j]",
            "test_distributions.py",
        ),
        (
            "distributions: mixture not stretched",
            "u / self.probability if",
            "u if",
            "test_distributions.py test_sweep_statistics.py",
        ),
    ),
    *_in(
        "tuning/reporting/statistics.py",
        (
            "statistics: index of the exact interval",
            "betaincinv(k, n - k + 1, tail)",
            "betaincinv(k, n - k, tail)",
            "test_sweep_statistics.py",
        ),
        (
            "statistics: biased deviation in Student's interval",
            "float(differences.std(ddof=1))",
            "float(differences.std(ddof=0))",
            "test_sweep_statistics.py test_tuning.py",
        ),
        (
            "statistics: one tail of McNemar's test",
            "min(2.0 * tail, 1.0)",
            "min(tail, 1.0)",
            "test_sweep_statistics.py",
        ),
    ),
    *_in(
        "tuning/campaign/analysis/sobol.py",
        (
            "sobol: A and B swapped in the first index",
            "np.mean(b * (mixed - a), axis=0)",
            "np.mean(a * (mixed - b), axis=0)",
            "test_sweep_sensitivity.py",
        ),
    ),
    *_in(
        "tuning/space/bijections.py",
        (
            "bijections: factor of the coupled set",
            "lambda k2: 0.75 * k2 * k2",
            "lambda k2: 0.80 * k2 * k2",
            "test_space.py",
        ),
        (
            "bijections: sign of the margin in the inverse of Below",
            "share = gain / (edge * (1.0 - MARGIN))",
            "share = gain / (edge * (1.0 + MARGIN))",
            "test_space.py",
        ),
        (
            "bijections: factor in the observer's edge",
            "rising = 2.0 * jnp.cosh",
            "rising = 1.5 * jnp.cosh",
            "test_space.py",
        ),
    ),
    *_in(
        "tuning/problem/objective.py",
        (
            "objective: roll not squared",
            "return over * over",
            "return over",
            "test_tuning.py",
        ),
    ),
    *_in(
        "tuning/problem/aggregates.py",
        (
            "aggregates: mean forgotten in log-mean-exp",
            "jax.nn.logsumexp(scaled) - jnp.log(costs.shape[0])",
            "jax.nn.logsumexp(scaled)",
            "test_tuning.py",
        ),
    ),
    *_in(
        "jaxglider/export/c/operations.py",
        (
            "export: cases of a choice swapped",
            "{which.text} ? {cases[1].text} : {cases[0].text}",
            "{which.text} ? {cases[0].text} : {cases[1].text}",
            "test_lowering.py",
        ),
        (
            "export: a subtraction adds",
            '"sub": "-"',
            '"sub": "+"',
            "test_lowering.py",
        ),
    ),
    *_in(
        "jaxglider/onboard/guard.py",
        (
            "guard: a clock that stands still has stepped",
            "finite & (elapsed > 0.0) & (elapsed <= gap)",
            "finite & (elapsed <= gap)",
            "test_autopilot.py",
        ),
    ),
]


def main() -> int:
    """Run the mistakes that are asked for; print a table."""
    options = _options()
    chosen = [
        m
        for m in MUTATIONS
        if not options.words or any(w in m.name for w in options.words)
    ]
    lost = [m for m in chosen if (ROOT / m.file).read_text("utf-8").count(m.old) != 1]
    for mutation in lost:
        print(
            f"{mutation.file} must hold {mutation.old!r} exactly once, for "
            f"{mutation.name!r}: bring the text in {Path(__file__).name} up to date."
        )
    if lost or not chosen:
        return 2
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        os.environ.setdefault("JAXGLIDER_TEST_CACHE", f"{folder}/cache")
        if not options.trust:
            named = list(dict.fromkeys(t for m in chosen for t in m.tests.split()))
            failed = _first_failure(Path(folder), None, [f"tests/{t}" for t in named])
            if failed:
                print(f"{failed} fails without any mistake: mend it first.")
                return 2
        return _campaign(Path(folder), chosen, options.whole)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("words", nargs="*", help="words of names; all without any")
    parser.add_argument(
        "--whole", action="store_true", help="run the rest of the suite on survivors"
    )
    parser.add_argument(
        "--trust", action="store_true", help="spare the run without a mistake"
    )
    return parser.parse_args()


def _campaign(folder: Path, chosen: list[Mutation], whole: bool) -> int:
    survivors = 0
    print("| mistake | seconds | noticed by |\n|---|---|---|", flush=True)
    for mutation in chosen:
        start = time.monotonic()
        tests = [f"tests/{t}" for t in mutation.tests.split()]
        noticed = _first_failure(folder, mutation, tests)
        if not noticed and whole:
            noticed = _first_failure(folder, mutation, ["tests"])
        survivors += not noticed
        seconds = time.monotonic() - start
        print(
            f"| {mutation.name} | {seconds:.0f} | {noticed or '**survives**'} |",
            flush=True,
        )
    print(f"\n{len(chosen) - survivors} of {len(chosen)} mistakes are noticed.")
    return 1 if survivors else 0


def _first_failure(folder: Path, mutation: Mutation | None, tests: list[str]) -> str:
    """The first test that fails on a copy with the mistake, or nothing."""
    tree = folder / "tree"
    shutil.rmtree(tree, ignore_errors=True)
    shutil.copytree(ROOT, tree, ignore=LEFT_OUT)
    if mutation is not None:
        mutation.apply(tree)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree)},
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    if done.returncode == 0:
        return ""
    if done.returncode not in (1, 2):
        raise RuntimeError(f"pytest could not run: {done.stdout}{done.stderr}")
    seen = re.search(r"^(?:FAILED|ERROR) (?:tests/)?(\S+)", done.stdout, re.MULTILINE)
    return seen.group(1) if seen else "an error on the way"


if __name__ == "__main__":
    sys.exit(main())
