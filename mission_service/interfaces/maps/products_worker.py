"""Writes the products of a run in a separate process, because they take many seconds to compute.

The process reads a ``ProductsJob`` (msgpack) from standard input and writes a zip file to standard
output, or one line to standard error and exits with 1.
"""

import os
import sys
import tempfile
from datetime import datetime
from pathlib import Path

import msgspec

from mission_service.sensors.worker_process import NICENESS


class ProductsJob(msgspec.Struct, frozen=True):
    """The journal, the length of the forecast, and the calendar time of mission time 0.

    ``time_zero`` is None for that of the scenario.
    """

    journal: str
    forecast_s: float
    time_zero: datetime | None


def products_zip(job: ProductsJob) -> bytes:
    """Return the products as a zip file. Raises MissionServiceError and FireModelError."""
    from mission_service.products.journal_incident import incident_in
    from mission_service.products.vector_files import write_zip
    from mission_service.products.write import write_products

    incident = incident_in(Path(job.journal), None, job.forecast_s, job.time_zero)
    with tempfile.TemporaryDirectory() as folder:
        out, packed = Path(folder) / "products", Path(folder) / "products.zip"
        out.mkdir()
        names = write_products(out, incident)
        contents = {name: (out / name).read_bytes() for name in names}
        write_zip(packed, contents, incident.utc(incident.at_s))
        return packed.read_bytes()


def main() -> int:
    """Carry out the job on standard input; return the exit status."""
    from firemodel.errors import FireModelError
    from mission_service.errors import MissionServiceError

    os.nice(NICENESS)
    job = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=ProductsJob)
    try:
        sys.stdout.buffer.write(products_zip(job))
    except (MissionServiceError, FireModelError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
