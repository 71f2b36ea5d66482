"""Sensors are sources of observations of the fire, found through entry points.

The key ``estimate.sensors`` of a scenario names sensors of this service
(``mission_service.sensors``) and of other packages. The service's own simulated cameras
(``simulated_cameras``) have the same method ``observe``.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import datetime
from importlib.metadata import entry_points
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.errors import ScenarioError, in_words
from mission_service.events import AnyEvent, FireObserved, Observed, Telemetry

GROUP = "mission_service.sensors"
STATION = "sensor"  # in the reports of sensors
MAX_IMAGES = 12  # per sensor, for interfaces

Scale = tuple[tuple[float, str], ...]  # values and their colours (#rrggbb), in ascending order
Bounds = tuple[float, float, float, float]  # top, left, bottom, right; in rows and columns


class SensorImage(NamedTuple):
    """A georeferenced image for maps; neither the estimate nor the journal uses it.

    Positions are rows and columns of the landscape's grid. ``colours`` returns red, green, blue and
    opacity (n, 4) at positions (n, 2); positions that the image does not show are transparent. The
    ellipse has semi-axes of one standard deviation of the position.
    """

    number: int  # increases with each image of the sensor
    at_us: int  # mission time
    vehicle: str
    name: str  # of the file or stream
    bounds: Bounds  # of the ground that the image shows
    colours: Callable[[Floats], NDArray[np.uint8]]
    scale: Scale  # of the colours
    unit: str  # of the scale's values
    centre: tuple[float, float]  # row and column of the ellipse
    major_m: float
    minor_m: float
    major_from_grid_north_deg: float


class Sensor(Protocol):
    """A source of observations of the fire.

    A sensor's methods are called on the event loop and must return at once. A sensor must use a
    thread to wait for files or sockets; ``observe`` then returns an observation that has arrived. A
    sensor may also have these attributes:

    - ``problem``: a text that is shown as an alarm unless it is empty.
    - ``report(at_us)``: a method that returns a report on positions, or None, and is called several
      times a second, even without a vehicle. The estimate weighs the report like the request
      ``observe``. The field ``at_us`` of the report must equal the argument.
    - ``skip(names)``: a method that receives, after a restart, the names of the events that the
      run has already used (``Observed.file``, ``FireObserved.file``).
    - ``restore_burned(since_s, at_us)``: a method that is called after a restart at mission time
      ``at_us``. ``since_s`` (y, x) contains the mission time in seconds since which the sensor's
      observations have shown a cell as burned, and infinity for all other cells.
    - ``images``: the latest images for the map (``SensorImage``), the newest one last. The method
      ``colours`` of an image is called in other threads, when a client requests the image's
      picture. At most ``MAX_IMAGES`` images of a sensor are shown.
    - ``close()``: a method that ends the sensor's threads; it is called at the end of a live run.
    """

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return a new observation, or None.

        The method is called with each position of a vehicle, before the position is processed. The
        window of the observation lies on the landscape's grid. The observation must be for the
        vehicle of the position, and from the same or an earlier time.
        """

    def on_event(self, event: AnyEvent) -> None:
        """Process an event of the run, such as an attitude or a lost position fix."""


MakeSensor = Callable[[Scenario, Landscape], Sensor]


class Sensors:
    """The sensors of a run. A sensor that fails is not used again; ``failed`` gives the reason."""

    def __init__(self, sensors: Mapping[str, Sensor], shape: tuple[int, int]) -> None:
        """Set the sensors by name, and the shape (rows, columns) of the landscape's grid."""
        self._sensors, self._shape = dict(sensors), shape
        self._all = tuple(sensors.values())
        self.failed: dict[str, str] = {}

    def observe(self, fix: Telemetry) -> list[Observed]:
        """Return the new observations of all sensors at a vehicle's position report."""
        found = []
        for name, sensor in list(self._sensors.items()):
            try:
                seen = sensor.observe(fix)
                if seen is not None:
                    found.append(self._checked(name, seen, fix))
            except (Exception, SystemExit) as error:  # another package may raise anything
                self._fail(name, error)
        return found

    def reports(self, at_us: int) -> list[FireObserved]:
        """Return new reports of all sensors at the given mission time, at most one per sensor."""
        found = []
        for name, sensor in list(self._sensors.items()):
            report = getattr(sensor, "report", None)
            try:
                made = None if report is None else report(at_us)
                if made is not None:
                    found.append(_checked_report(name, made, at_us))
            except (Exception, SystemExit) as error:  # another package may raise anything
                self._fail(name, error)
        return found

    def images(self) -> dict[str, tuple[SensorImage, ...]]:
        """Return the latest images by sensor, if there are any; the newest one last."""
        found = {}
        for name, sensor in list(self._sensors.items()):
            try:
                images: tuple[Any, ...] = tuple(getattr(sensor, "images", ()))[-MAX_IMAGES:]
                if not all(isinstance(each, SensorImage) for each in images):
                    raise ValueError(
                        "its attribute `images` contains objects other than SensorImage"
                    )
                if images:
                    found[name] = images
            except (Exception, SystemExit) as error:  # another package may raise anything
                self._fail(name, error)
        return found

    def skip(self, names: frozenset[str]) -> None:
        """Pass the names of the events used in the run before a restart to the sensors."""
        for name, sensor in list(self._sensors.items()):
            try:
                getattr(sensor, "skip", lambda names: None)(names)
            except (Exception, SystemExit) as error:  # another package may raise anything
                self._fail(name, error)

    def restore_burned(self, since_s: Mapping[str, Floats], at_us: int) -> None:
        """Pass to each sensor the cells that it showed as burned before a restart."""
        for name, sensor in list(self._sensors.items()):
            try:
                if name in since_s:
                    getattr(sensor, "restore_burned", lambda *_: None)(since_s[name], at_us)
            except (Exception, SystemExit) as error:  # another package may raise anything
                self._fail(name, error)

    def close(self) -> None:
        """End the threads of all sensors, including those that have failed."""
        for sensor in self._all:
            # Another package may raise anything; the run ends.
            with suppress(Exception, SystemExit):
                getattr(sensor, "close", lambda: None)()

    def use_mission_time(self, zero: datetime) -> None:
        """Set the mission time, which begins at ``zero``, in sensors that use mission time.

        A simulation calls this method because simulated time differs from that of the clock.
        """
        for sensor in self._sensors.values():
            use = getattr(sensor, "use_mission_time", None)
            if use is not None:
                use(zero)

    def problems(self) -> dict[str, str]:
        """Return why sensors have failed, and the problems that sensors report, by sensor."""
        reported = {name: str(getattr(each, "problem", "")) for name, each in self._sensors.items()}
        found = {name: f"sensor {name}: {text}" for name, text in reported.items() if text}
        return found | self.failed

    def on_event(self, event: AnyEvent) -> None:
        """Pass an event to the sensors."""
        for name, sensor in list(self._sensors.items()):
            try:
                sensor.on_event(event)
            except (Exception, SystemExit) as error:  # another package may raise anything
                self._fail(name, error)

    def _checked(self, name: str, seen: Observed, fix: Telemetry) -> Observed:
        """Return an observation with its source. Raises ValueError for an unusable observation."""
        if not isinstance(seen, Observed):
            raise ValueError(f"it returned {type(seen).__name__} instead of Observed")
        seen = msgspec.convert(msgspec.to_builtins(seen), Observed)  # checks types and limits
        widths = {len(row) for row in seen.cells}
        rows, cols = self._shape
        letters = set("".join(seen.cells))
        if len(widths) != 1 or not letters - {"."}:
            raise ValueError("its window has rows of different lengths, or no observed cell")
        if not letters <= set(".ub"):
            raise ValueError("its cells contain letters other than b, u and .")
        if not (0 <= seen.row <= rows - len(seen.cells) and 0 <= seen.col <= cols - widths.pop()):
            raise ValueError(f"its window exceeds the landscape's grid of {rows} x {cols} cells")
        if seen.vehicle != fix.vehicle or seen.at_us > fix.at_us:
            raise ValueError(
                "its vehicle is not that of the position, or its time is later than the position's"
            )
        return msgspec.structs.replace(
            seen, source=name, corrects=False, estimated=False, distrusted=False
        )

    def _fail(self, name: str, error: BaseException) -> None:
        del self._sensors[name]
        try:
            words = in_words(error)
        except Exception:  # the error's own ``__str__`` may fail
            words = type(error).__name__
        self.failed[name] = f"sensor {name} failed and is not used until a restart: {words}"


def _checked_report(name: str, made: FireObserved, at_us: int) -> FireObserved:
    """Return a report with its sender. Raises ValueError for an unusable report."""
    if not isinstance(made, FireObserved):
        raise ValueError(f"it returned {type(made).__name__} instead of FireObserved")
    made = msgspec.convert(msgspec.to_builtins(made), FireObserved)  # checks types and limits
    if made.at_us != at_us or made.seen_at_us > at_us:
        raise ValueError(
            "its report has another at_us than the position, or a later observation time"
        )
    return msgspec.structs.replace(
        made, by=name, station=STATION, source=made.source or name, may_approve=False, role=""
    )


def sensors_of(scenario: Scenario, landscape: Landscape) -> Sensors:
    """Return the sensors that a scenario names.

    Raises ScenarioError for an unknown sensor, and for a sensor that cannot be loaded or created.
    """
    found = {}
    for name in scenario.estimate.sensors:
        points = tuple(entry_points(group=GROUP, name=name))
        where = f"{scenario.name}: estimate.sensors: {name}"
        if len(points) != 1:
            known = ", ".join(sorted({each.name for each in entry_points(group=GROUP)})) or "none"
            found_in = f"{len(points)} installed packages provide this sensor, not one"
            raise ScenarioError(f"{where}: {found_in}; the installed sensors are {known}")
        try:
            make: MakeSensor = points[0].load()
            found[name] = make(scenario, landscape)
        except ScenarioError as error:
            raise ScenarioError(f"{where}: {error}") from error
        except (Exception, SystemExit) as error:  # another package may raise anything
            raise ScenarioError(f"{where}: {type(error).__name__}: {error}") from error
    return Sensors(found, landscape.shape)
