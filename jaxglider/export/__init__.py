"""The tuned autopilot as C99, generated from the trace of what was tuned."""

from jaxglider.export.bundle import Bundle as Bundle
from jaxglider.export.bundle import export_c as export_c
from jaxglider.export.c.block import ExportError as ExportError
