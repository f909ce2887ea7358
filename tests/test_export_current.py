"""In a current, exported code is told the velocity through the water."""

import dataclasses
import shutil
import subprocess

import compiled_c
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxglider import paper
from jaxglider.environment.water import Current, Water
from jaxglider.export import bundle
from jaxglider.export.vectors import fly, sea
from jaxglider.onboard.of_loop import autopilot

CURRENT = np.array([0.06, -0.08, 0.0])
SHEAR = 1e-3


@pytest.fixture(scope="module")
def loop():
    still = paper.make_loop("switching", "printed", "smc")
    north, east, _ = CURRENT
    water = Water(Current(north=north, east=east, shear_north=SHEAR))
    return dataclasses.replace(
        still, scenario=dataclasses.replace(still.scenario, water=water)
    )


@pytest.fixture(scope="module")
def made(loop):
    """An export whose closed loop is a short one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bundle, "CLOSED_LOOP", 50.0)
        return bundle.export_c(loop, "smc in a current")


def test_the_autopilot_is_told_the_velocity_through_the_water(loop):
    log, after = fly(autopilot(loop), loop, sea(loop, bundle.VECTOR_TICKS, bundle.HOLD))
    told, over = (
        {k: np.asarray(x) for k, x in vars(s).items()}
        for s in (log.measured, jax.tree.map(lambda x: x[:-1], after))
    )
    angles = np.stack([over[k] for k in ("heading", "pitch", "roll")], axis=1)
    drift = np.tile(CURRENT, (len(angles), 1))
    drift[:, 0] += SHEAR * over["depth"]
    drift = Rotation.from_euler("ZYX", angles).inv().apply(drift)
    for n, name in enumerate(("surge", "sway", "heave")):
        through = over[name] - drift[:, n]
        np.testing.assert_allclose(told[name][1:], through, rtol=0, atol=1e-13)
    assert np.ptp(drift[:, 0]) > 1e-3
    for name in ("north", "depth", "pitch", "yaw_rate"):
        np.testing.assert_array_equal(told[name][1:], over[name])
    assert jnp.isfinite(log.command.buoyancy_mass).all()


@pytest.mark.skipif(
    compiled_c.COMPILER is None or shutil.which("make") is None,
    reason="no make or no C compiler on this machine",
)
def test_the_closed_loop_in_c_is_told_it_too(made, tmp_path):
    made.write(tmp_path)
    parity = tmp_path / "test" / "parity.c"

    def checked():
        order = ["make", "parity_double"]
        done = subprocess.run(order, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        ran = subprocess.run(
            ["./parity_double"], cwd=tmp_path, capture_output=True, text=True
        )
        return {line.split()[1]: line for line in ran.stdout.splitlines()}

    said = checked()
    assert all(line.endswith(": pass") for line in said.values()), said
    assert "  1000 ticks" in said["test/closed_loop.csv"]
    # Told the velocity over ground, the same code flies elsewhere.
    right = parity.read_text()
    wrong = right.replace("measure(&seen,", "measure(&afloat,")
    assert wrong != right
    parity.write_text(wrong)
    said = checked()
    assert said["test/closed_loop.csv"].endswith("FAIL")
    assert said["test/vectors.csv"].endswith("pass")
