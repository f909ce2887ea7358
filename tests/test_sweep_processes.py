"""Campaigns in processes of their own: killed, on two devices, on two hosts."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest
from toy_campaign import RUN

from tuning.campaign.run.store import read_manifest

MEMBERS = 1500


class Runs:
    """Commands of one campaign that share compiled programs."""

    def __init__(self, folder):
        self.folder = folder

    def start(self, out, *more, devices=1):
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("JAX", "XLA"))}
        # With the optimisation that users have: what is promised is every bit.
        count = f"--xla_force_host_platform_device_count={devices}"
        told = ["--members", str(MEMBERS), "--duration", "30"]
        told += ["--out", str(self.folder / out), *more]
        return subprocess.Popen(
            [sys.executable, "-m", "tuning", *RUN.split(), *told],
            env={
                **kept,
                "JAX_PLATFORMS": "cpu",
                "XLA_FLAGS": count,
                "XDG_CACHE_HOME": str(self.folder),
                # The small programs too: together they take as long as the large one.
                "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
            },
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def rows(self, out):
        return (self.folder / out / "rows.bin").read_bytes()


def finish(running):
    _, err = running.communicate(timeout=300)
    assert running.returncode == 0, err


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return Runs(tmp_path_factory.mktemp("sweep"))


@pytest.fixture(scope="module")
def whole(runs):
    """Rows of an uninterrupted campaign, on two devices."""
    finish(runs.start("whole", devices=2))
    size = read_manifest(runs.folder / "whole").row_type().itemsize
    assert len(runs.rows("whole")) == MEMBERS * size
    return runs.rows("whole")


def test_killed_and_resumed_on_one_device_it_has_the_same_rows(runs, whole):
    running = runs.start("killed")
    rows = runs.folder / "killed/rows.bin"
    deadline = time.monotonic() + 120.0
    while not (rows.exists() and rows.stat().st_size) and time.monotonic() < deadline:
        time.sleep(0.005)
    running.send_signal(signal.SIGKILL)
    running.communicate()
    assert running.returncode == -signal.SIGKILL
    assert whole.startswith(rows.read_bytes()[: 512 * len(whole) // MEMBERS])
    finish(runs.start("killed", "--resume"))
    assert runs.rows("killed") == whole


def test_two_hosts_have_the_same_rows(runs, whole):
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    told = ["--coordinator", f"localhost:{port}", "--hosts", "2", "--host"]
    both = [runs.start("hosts", *told, str(host)) for host in (0, 1)]
    for running in both:
        finish(running)
    assert runs.rows("hosts") == whole
    assert runs.rows("hosts/host-0") + runs.rows("hosts/host-1") == whole
