"""The results of tuning and of a sweep: tables, pictures and files."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tomli_w
from matplotlib.figure import Figure

from jaxglider.files.gains import encode_law
from jaxglider.files.law_paths import short_name
from jaxglider.files.writing import provenance, write_json, write_text
from jaxglider.plotting.style import PAGE, legend_above, look, new_figure
from jaxglider.simulation.closed_loop import ClosedLoop
from jaxglider.simulation.rollout import Trajectory, simulate
from tuning.campaign.analysis.summary import CampaignSummary
from tuning.campaign.report import figures
from tuning.campaign.report.conclude import write_conclusions
from tuning.campaign.report.text import text_summary
from tuning.campaign.run.campaign import Campaign
from tuning.campaign.run.rows import Rows, columns_of
from tuning.campaign.run.store import Manifest, opened, prepare
from tuning.evaluation.figures import draw_gains, draw_objective, gains_of
from tuning.evaluation.held_out import Verdict
from tuning.evaluation.report import history_table, text_report, write_tuning_report
from tuning.evaluation.robustness import Robustness
from tuning.gradient_check.statement import GradientStatement
from tuning.problem.lanes import member_count
from tuning.problem.problem import TuningProblem
from tuning.reporting.output_folder import writing_to
from tuning.search.adversarial import AdversarialRound, rounds_dict
from tuning.search.settings import Step


@dataclasses.dataclass(frozen=True)
class TuneResult:
    """Result of tuning.

    Attributes:
        problem: problem that was solved.
        loop: closed loop with the tuned gains.
        verdict: comparison of before and after on members that tuning did not see.
        history: steps of the search, the start first.
        method: name of the search, `gradient`, `cma` or `random`.
        notes: remarks on the start, the gradient and the sets.
        gradient: worth of the exact gradient at the tuned gains, on the nominal case as
            it is flown; None where it was not asked for.
        robustness: figures at other ticks and from other roundings; None where they
            were not asked for.
        searches: adversarial rounds, and behind them the search for the worst members
            of the tuned gains; empty without.
        interrupted: whether the search was stopped before its end; the gains are the
            best until then.
        seconds: time that it took [s].
    """

    problem: TuningProblem
    loop: ClosedLoop
    verdict: Verdict
    history: list[Step]
    method: str
    notes: tuple[str, ...]
    gradient: GradientStatement | None
    robustness: Robustness | None
    searches: tuple[AdversarialRound, ...]
    interrupted: bool
    seconds: float

    @property
    def gains(self) -> dict[str, tuple[float, float]]:
        """Value before and after of each number that was tuned, by its dotted path."""
        space = self.problem.space
        before, after = space.values(self.problem.loop), space.values(self.loop)
        return {name: (before[name], after[name]) for name in before}

    def __str__(self) -> str:
        """The held-out comparison and the gains, as a table."""
        return text_report(self.to_dict())

    def to_dict(self) -> dict[str, Any]:
        """Everything but the history as plain numbers, as it stands in tune.json."""
        problem = self.problem
        sets = ("training", "validation", "test")
        return {
            "scenario": problem.spec.case.title,
            "plant": problem.spec.case.plant,
            "vehicle": problem.spec.case.vehicle,
            "controller": short_name(problem.spec.controller),
            "method": self.method,
            "steps": self.history[-1].number,
            "refused": sum(step.refused for step in self.history),
            "members": {name: member_count(getattr(problem, name)) for name in sets},
            "gains": {
                name: {"before": before, "after": after}
                for name, (before, after) in self.gains.items()
            },
            **self.verdict.to_dict(),
            "gradient": None if self.gradient is None else self.gradient.to_dict(),
            "robustness": None
            if self.robustness is None
            else self.robustness.to_dict(),
            "adversarial": rounds_dict(self.searches),
            "notes": list(self.notes),
            "seconds": round(self.seconds, 1),
        }

    def to_xarray(self) -> Any:
        """The history as an `xarray.Dataset` over steps and names of gains.

        Raises:
            ImportError: xarray is not installed.
        """
        import xarray

        space, loop = self.problem.space, self.problem.loop
        gains = [
            list(space.values(space.write(loop, step.free)).values())
            for step in self.history
        ]
        columns = ("loss", "validation", "refused", "best", "learning_rate")
        series = {
            name: ("step", [getattr(step, name) for step in self.history])
            for name in columns
        }
        return xarray.Dataset(
            {**series, "gain": (("step", "name"), gains)},
            coords={
                "step": [step.number for step in self.history],
                "name": list(space.names),
            },
        )

    def plot(self) -> Figure:
        """The objective and the gains that moved most, step by step."""
        with look():
            figure = new_figure(PAGE, 3.4)
            left, right = figure.subplots(1, 2)
            draw_objective(left, self.history)
            gains = gains_of(self.problem, self.history)
            draw_gains(right, self.history, gains)
            legend_above(right, right.get_legend_handles_labels()[0])
        return figure

    def trajectories(self) -> dict[str, Trajectory]:
        """The nominal case flown `before` and `after`, on the host."""
        run = jax.jit(simulate)
        key, scenario = jax.random.key(0), self.problem.loop.scenario
        chance = scenario.sea(key), scenario.noise(key)
        return {
            "before": jax.device_get(run(self.problem.loop, *chance)),
            "after": jax.device_get(run(self.loop, *chance)),
        }

    def save(
        self, folder: str | Path, *, command: Sequence[str] = (), **more: Any
    ) -> dict[str, Any]:
        """Write gains.toml, history.csv, tune.json and report.md with its figures.

        Args:
            folder: folder to write to; made if it is not there.
            command: words of the command line that made the result, for provenance.
            **more: further entries of tune.json; those that are not None stand in the
                gains file's provenance too.

        Returns:
            The content of tune.json.

        Raises:
            OSError: it cannot be written.
        """
        out = Path(folder)
        about = provenance(
            command=list(command),
            precision=8 * self.problem.loop.scenario.clock.dt.dtype.itemsize,
            partial=self.interrupted,
        )
        result = {**self.to_dict(), **more, "provenance": about}
        words = ["jaxglider", *command] if command else ["tuning.tune", "from Python"]
        gains = {
            **encode_law(self.loop, out),
            "provenance": {
                "command": " ".join(words),
                "created": about["created"],
                "scenario": result["scenario"],
                "plant": result["plant"],
                **{key: value for key, value in more.items() if value is not None},
                **({"gradient": self.gradient.text()} if self.gradient else {}),
                "versions": about["versions"],
            },
        }
        write_text(out / "gains.toml", tomli_w.dumps(gains))
        write_text(out / "history.csv", history_table(self.problem, self.history))
        write_json(out / "tune.json", result)
        runs = self.trajectories()
        write_tuning_report(out, self.problem, self.history, result, self.loop, runs)
        return result


@dataclasses.dataclass(frozen=True)
class SweepResult:
    """Result of a campaign.

    Attributes:
        campaign: campaign that was run.
        rows: rows of its members, to be read by column.
        summary: probabilities, quantiles and comparisons as plain numbers, as they
            stand in summary.json.
        interrupted: whether it was stopped before its last member.
    """

    campaign: Campaign
    rows: Rows
    summary: CampaignSummary
    interrupted: bool

    def __str__(self) -> str:
        """The summary as a table."""
        return text_summary(self.summary)

    def to_xarray(self) -> Any:
        """Draws and outcomes as an `xarray.Dataset` over members and loops.

        Raises:
            ImportError: xarray is not installed.
        """
        import xarray

        outcomes = np.asarray(self.rows.rows["metrics"])
        draws = {
            name: ("member", np.asarray(self.rows.rows["values"][:, column]))
            for column, name in enumerate(self.campaign.uncertainty.names())
        }
        runs = {
            f"run_{name.replace('.', '_')}": (
                ("member", "loop"),
                outcomes[:, :, column],
            )
            for column, name in enumerate(columns_of(flight=self.rows.has_flight))
        }
        return xarray.Dataset(
            {**draws, **runs},
            coords={
                "member": np.asarray(self.rows.rows["member"]),
                "loop": list(self.campaign.labels),
            },
        )

    def plot(self) -> Figure:
        """The distribution of each channel's error, a line for each loop."""
        with look():
            figure = new_figure(PAGE, 2.4)
            figures.distributions(figure.subplots(1, 3, sharey=True), self.rows)
        return figure

    def save(
        self, folder: str | Path, *, overwrite: bool = False, report: bool = True
    ) -> None:
        """Write what `jaxglider sweep` writes: rows, summary, NetCDF and report.

        Args:
            folder: folder to write to; made if it is not there.
            overwrite: whether to discard a campaign that it holds.
            report: whether there is to be a report with figures.

        Raises:
            ValueError: the folder holds a campaign.
            OSError: it cannot be written.
        """
        out = Path(folder)
        campaign, rows, summary = self.campaign, self.rows.rows, self.summary
        members = campaign.settings.members
        manifest = Manifest.of(campaign, 0, members, summary.provenance)
        with writing_to(out):
            prepare(out, manifest, resume=False, overwrite=overwrite)
            with opened(out, manifest.row_type(), 0) as store:
                store.append(rows)
            write_conclusions(out, campaign, manifest, rows, summary, report=report)
