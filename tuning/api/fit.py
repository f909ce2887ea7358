"""A vehicle fitted to its flight record, from Python."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jaxglider.core.containers import check_interval
from jaxglider.files.writing import provenance, write_json, write_text
from jaxglider.plotting.save import save
from jaxglider.vehicle.parameters import VehicleData
from jaxglider.vehicle.published import load_vehicle
from tuning.identification.fitting import Fit, fit_flight
from tuning.identification.glider import resized
from tuning.identification.knowledge import Estimate, estimates, remarks
from tuning.identification.record.flight_record import FlightRecord
from tuning.identification.record.reading import read_record
from tuning.identification.record.uniform import uniform
from tuning.identification.report.figures import fit_figure, residuals_figure
from tuning.identification.report.files import vehicle_of_fit, write_files
from tuning.identification.report.report import (
    content_of,
    estimate_named,
    markdown_of,
    text_of,
)
from tuning.identification.verdict import Verdict, judge
from tuning.reporting.html import write_html
from tuning.reporting.output_folder import writing_to


@dataclasses.dataclass(frozen=True)
class FitResult:
    """A vehicle fitted to its record, judged on dives that the fit has not seen.

    Attributes:
        fit: the fit: glider before and after, free numbers, covariance, noise.
        verdict: errors on held-out dives, and the simulations behind them.
        record: record that it was made on.
        remarks: warnings in words; read them first.
        origin: name or path of the vehicle that it started from.
    """

    fit: Fit
    verdict: Verdict
    record: FlightRecord
    remarks: tuple[str, ...]
    origin: str

    @property
    def vehicle(self) -> VehicleData:
        """The fitted vehicle, for `jaxglider.full_plant` and the like."""
        return vehicle_of_fit(self.fit, f"{self.fit.vehicle.name} fitted")

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The free numbers before and after, with intervals."""
        return estimates(self.fit)

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of one number by its name."""
        return estimate_named(self.estimates, name)

    def content(self) -> dict[str, Any]:
        """All results as plain numbers and sentences."""
        found = content_of(self.fit, self.verdict, self.remarks)
        found["record"] = {
            "name": self.record.name,
            "kind": self.record.kind,
            "sha256": self.record.digest,
            "findings": [
                {"channel": f.channel, "text": f.text} for f in self.record.findings
            ],
        }
        return found

    def __str__(self) -> str:
        return text_of(self.content())

    def save(self, folder: str | Path, command: Sequence[str] = ()) -> dict[str, Any]:
        """Write vehicle, uncertainty, mission, reports, figures and numbers.

        Args:
            folder: folder; made if it is not there.
            command: words of the command line, for the provenance.

        Returns:
            The content of fit.json.
        """
        place = Path(folder)
        with writing_to(place):
            source = (
                f"{self.record.name}, {self.fit.plan.kind}, record SHA-256 "
                f"{self.record.digest[:12]}"
            )
            name = f"{self.fit.vehicle.name} fitted"
            files = write_files(self.fit, place, name, source, self.origin)
            content = {
                **self.content(),
                "files": files,
                "provenance": provenance(command=list(command)),
            }
            write_json(place / "fit.json", content)
            save(fit_figure(self.fit, self.verdict), place / "fit.png")
            save(residuals_figure(self.fit, self.verdict), place / "residuals.png")
            text = markdown_of(content)
            write_text(place / "report.md", text)
            write_html(place / "report.html", text, content["provenance"])
        return content


def fit(
    record: FlightRecord | str | Path | Sequence[str | Path],
    vehicle: str | Path | VehicleData = "slocum",
    *,
    kind: str = "driven",
    free: Sequence[str] = (),
    speed: bool = True,
    mass: float | None = None,
    volume: float | None = None,
    held_out: str = "half",
    worst: int = 2,
    out: str | Path | None = None,
) -> FitResult:
    """Fit a vehicle to its flight record and judge it on dives held out.

    Double precision is needed: call `jax.config.update("jax_enable_x64", True)` first.

    Args:
        record: record, or the files of one flight as `read_record` takes them.
        vehicle: vehicle to start from; the standard deviations of its file are priors.
        kind: `steady` glides in balance; `driven` by the recorded pitch, turns too;
            `closed`, from the actuators alone, with the full plant.
        free: names of the numbers to fit, `*` for any letters; by default those that
            such a record may tell.
        speed: whether a recorded speed through the water is fitted, or judges only.
        mass: mass of the glider as weighed [kg]; the vehicle's hull is changed to it.
        volume: volume displaced at the surface, no ballast pumped [m³]; by default the
            mass over the mean density of the record.
        held_out: `half`, the second half of the dives, or `alternate`, every other.
        worst: number of numbers, those told worst, whose likelihood is profiled.
        out: folder for all results.

    Raises:
        ValueError: an argument or a file cannot be used, or the record lacks something.
        FloatingPointError: the model is not finite where the fit begins.
    """
    check_interval("fit", "mass", mass, 0.0)
    check_interval("fit", "volume", volume, 0.0)
    origin = vehicle.name if isinstance(vehicle, VehicleData) else str(vehicle)
    start = vehicle if isinstance(vehicle, VehicleData) else load_vehicle(vehicle)
    if mass is not None:
        start = resized(start, mass)
    flown = record if isinstance(record, FlightRecord) else read_record(record)
    found = fit_flight(
        uniform(flown),
        start,
        volume,
        kind=kind,
        free=free,
        speed=speed,
        split=held_out,
        worst=worst,
    )
    verdict = judge(found)
    result = FitResult(found, verdict, flown, remarks(found, verdict, flown), origin)
    if out is not None:
        result.save(out)
    return result
