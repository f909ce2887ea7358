"""FxTPPC behind an estimator: what noise of the sensors costs it.

`python benchmarks/bench_noise.py` flies `switching` at 10 Hz, on `printed` and on
`rigid-body`, with perfect measurement and with depth and attitude alone, noisy as those
of real gliders: 5 cm, 0.2, 0.3 and 0.7 degrees. It prints L2[e] and chattering over
those of perfect measurement, channel by channel: with the gains that law, observer and
estimator begin with, with softer ones found by hand, and with all of them tuned
together by gradient from there, on other drawings of the noise than those that judge.
Run it in the folder above.
"""

import argparse
import dataclasses
import math
import sys
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxglider
from jaxglider import paper
from jaxglider.navigation.catalogue import make_estimator
from jaxglider.navigation.sensing.instrument import Compass, Instrument
from jaxglider.navigation.sensing.readings import Instruments, Sensed
from jaxglider.signals import CHANNELS
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.metrics import Metrics
from tuning import tune
from tuning.cli.session.jax_setup import start_jax
from tuning.search.settings import DescentSettings

DEGREE = math.pi / 180.0
TICK, DURATION = 0.1, 240.0
"""Control tick, and horizon with one change of attitude and heading in it [s]."""
JUDGES = range(100, 116)
"""Seeds of the noise that gains are judged by; none of them is tuned on."""
MEMBERS = 8
"""Drawings of the noise that gains are tuned on."""
ERROR, CHATTERING = 1.3, 1.6
"""Ratios to perfect measurement from which the tuned cost rises steeply."""
OBSERVER, LAW = 0.003, 0.5
"""Factors on the observer's integral gains, and on k1 and k2 of the law: with all of
them the observer turns noise into commands from end to end."""
ESTIMATOR = {"printed": (1.0, 0.3), "rigid-body": (0.1, 0.03)}
"""Factors on what the model-aided filter takes to be unknown: on what accelerates and
turns the glider, and on the walks of what its model has wrong."""


def sensors() -> Instruments:
    """Sensors of depth and attitude that read at every tick."""
    return Instruments(
        Sensed(
            Instrument(TICK, noise=0.05),
            Instrument(TICK, noise=0.2 * DEGREE),
            Instrument(TICK, noise=0.3 * DEGREE),
            Compass(TICK, noise=0.7 * DEGREE),
        )
    )


def on_sensors(loop: ClosedLoop, name: str) -> ClosedLoop:
    """The loop with noisy sensors and an estimator of that name."""
    model, instruments = loop.controller.model, sensors()
    assert model is not None
    scenario = dataclasses.replace(loop.scenario, instruments=instruments)
    estimator = make_estimator(name, model, instruments)
    return dataclasses.replace(loop, scenario=scenario, estimator=estimator)


def perfect(loop: ClosedLoop) -> ClosedLoop:
    """The loop with the same gains and perfect measurement."""
    scenario = dataclasses.replace(loop.scenario, instruments=None)
    return dataclasses.replace(loop, scenario=scenario, estimator=None)


def softer(loop: Any, plant: str) -> Any:
    """The loop with slower observer and estimator, and a law that is softer about zero.

    The gains that `rigid-body` begins with are soft about zero already, and those of
    the depth of `printed`, which are the paper's, are too small to hold it.
    """
    observer, law, estimator = loop.observer, loop.controller, loop.estimator
    integral = jax.tree.map(lambda x: OBSERVER * x, observer.integral)
    own = {name: getattr(law.gains, name) for name in CHANNELS}
    gains = {
        name: dataclasses.replace(gain, k1=LAW * gain.k1, k2=LAW * gain.k2)
        for name, gain in own.items()
    }
    if plant == "printed":
        gains = {
            name: dataclasses.replace(gain, mu=6.0, rho=0.9)
            for name, gain in gains.items()
        }
        gains["depth"] = dataclasses.replace(gains["depth"], k1=0.0006, k2=0.03)
    pushed, walked = ESTIMATOR[plant]
    slower = {
        name: factor * getattr(estimator, name)
        for names, factor in (
            (("acceleration", "turning"), pushed),
            (("mass_walk", "drag_walk", "moment_walk"), walked),
        )
        for name in names
    }
    return dataclasses.replace(
        loop,
        observer=dataclasses.replace(observer, integral=integral),
        controller=dataclasses.replace(law, gains=type(law.gains)(**gains)),
        estimator=dataclasses.replace(estimator, **slower),
    )


@jax.jit
def judged(loop: ClosedLoop, key: jax.Array) -> Any:
    """L2[e] and chattering of each channel."""
    scenario = loop.scenario
    return measures(jaxglider.evaluate(loop, scenario.sea(key), scenario.noise(key)))


def measures(metrics: Metrics) -> list[tuple[jax.Array, jax.Array]]:
    """L2[e] and chattering, a pair for each channel."""
    channels = [getattr(metrics.channels, name) for name in CHANNELS]
    return [(channel.rms_error, channel.chattering) for channel in channels]


def mean(loop: ClosedLoop) -> np.ndarray:
    """Mean over the drawings that judge, a row for each channel."""
    return np.mean([judged(loop, jax.random.key(n)) for n in JUDGES], axis=0)


def tuned(loop: ClosedLoop, best: np.ndarray, steps: int) -> ClosedLoop:
    """The loop with law, observer and estimator tuned together.

    Args:
        loop: closed loop to begin with.
        best: L2[e] and chattering of each channel with perfect measurement.
        steps: number of steps.
    """

    def cost(metrics: Metrics, _: Metrics) -> jax.Array:
        total = jnp.zeros(())
        for now, (error, chattering) in zip(measures(metrics), best, strict=True):
            wide = jnp.log(now[0] / (ERROR * error))
            restless = jnp.log(now[1] / (CHATTERING * chattering))
            total += 2.5 * jax.nn.softplus(8.0 * wide) + 0.1 * now[0] / error
            total += 0.25 * jax.nn.softplus(8.0 * restless)
        return total

    # Only the noise differs between members; one copy of each is enough.
    settings = DescentSettings(
        steps=steps, learning_rate=0.1, batch=MEMBERS, copies=MEMBERS, spread=0.0
    )
    result = tune(
        loop,
        free=["controller", "observer", "estimator"],
        members=MEMBERS,
        validation=MEMBERS,
        test=1,
        uncertainty=0.0,
        cost=cost,
        settings=settings,
        constraints=("k1-below-k2-squared",),
        gradient_memory=10.0,
        check=False,
        progress=False,
    )
    return result.loop


def cases(plant: str, steps: int) -> tuple[np.ndarray, dict[str, ClosedLoop]]:
    """Measures of perfect measurement, and the loops to be compared with it."""
    exact = paper.make_loop("switching", plant, "fxtppc", dt=TICK, duration=DURATION)
    best = mean(exact)
    noisy = on_sensors(exact, "model-aided")
    soft = softer(noisy, plant)
    together = tuned(soft, best, steps)
    return best, {
        "as they begin": noisy,
        "softer": soft,
        "tuned together": together,
        "tuned together, perfect measurement": perfect(together),
    }


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--plants", nargs="+", default=["printed", "rigid-body"])
    parser.add_argument("--steps", type=int, default=40, help="of the descent")
    options = parser.parse_args()
    start_jax(64, every_core=True)
    heads = [f"{what} {name}" for what in ("L2", "chattering") for name in CHANNELS]
    rows = ["| plant | gains | " + " | ".join(heads) + " |"]
    rows.append("|---|---|" + "---:|" * len(heads))
    for plant in options.plants:
        best, loops = cases(plant, options.steps)
        for words, loop in loops.items():
            ratio = (mean(loop) / best).T.ravel()
            numbers = " | ".join(f"{x:.2f}" for x in ratio)
            rows.append(f"| {plant} | {words} | {numbers} |")
            sys.stderr.write(rows[-1] + "\n")
    sys.stdout.write("\n".join(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
