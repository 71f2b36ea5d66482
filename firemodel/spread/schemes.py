"""List the spread schemes with name, class and settings, and create fires.

A new scheme requires a module and an entry in ``SCHEMES``. Scenario files, experiments and the
command line use this table. The module of a scheme is imported only when a fire is created, because
the module imports Numba.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from firemodel.errors import FireModelError
from firemodel.physics.acceleration import POINT_PER_S

if TYPE_CHECKING:
    from firemodel.landscape.landscape import Landscape
    from firemodel.physics import CrownMethod
    from firemodel.physics.weather import WeatherStream
    from firemodel.spread.fire_scheme import Burning, Closing, Fire, Ignition
    from firemodel.spread.firebrands import Firebrands

SchemeName = Literal["anyangle", "devs8", "probabilistic"]


class Scheme(NamedTuple):
    """The ``Fire`` class of a scheme, and the scheme's settings."""

    module: str
    fire: str  # the name of the class
    arguments: tuple[str, ...]  # of the class; also keys of a scenario's [fire] table
    random: bool = False  # True if the class has the argument ``rng``, a random generator
    emits_firebrands: bool = False  # True if the class has ``firebrands``

    @property
    def settings(self) -> tuple[str, ...]:
        """The settings of ``new_fire``, which are also keys of a scenario's [fire] table."""
        spotting = SPOTTING if self.emits_firebrands else ()
        return (*self.arguments, *spotting, *(() if self.random else (ACCELERATION,)))


CROWN = ("crown", "foliar_moisture_pct")
# 50 firebrands for a burning 30 m cell (Perryman et al. 2013), of which 1 % land on receptive fuel,
# the lowest "ignition frequency" commonly used in FARSITE.
FIREBRANDS_PER_HA, AIR_TEMPERATURE_C = 5.0, 25.0
P_SPREAD, UPDATE_S = 0.025, 60.0  # of the probabilistic scheme
ACCELERATION = "acceleration"
# Spot fires burn on the clock of the fire that emits them. Instead of accelerating, they begin
# later, by the eventual delay of an accelerating fire.
SPOT_FIRE_DELAY_S = 1.0 / POINT_PER_S
SPOTTING = ("spotting", "firebrands_per_ha", "air_temperature_c")
SCHEMES: dict[SchemeName, Scheme] = {
    "anyangle": Scheme(
        "firemodel.spread.anyangle",
        "AnyAngleFire",
        ("wind_limit", "precise", *CROWN),
        emits_firebrands=True,
    ),
    "devs8": Scheme("firemodel.spread.devs8", "Devs8Fire", ("wind_limit", *CROWN)),
    "probabilistic": Scheme(
        "firemodel.spread.probabilistic", "ProbabilisticFire", ("p_spread", "update_s"), random=True
    ),
}


def new_fire(
    name: SchemeName,
    landscape: "Landscape",
    weather: "WeatherStream",
    ignitions: "Sequence[Ignition]",
    burning: "Burning | None" = None,
    *,
    seed: int | tuple[int, ...] = 0,
    closings: "Sequence[Closing]" = (),
    **settings: Any,
) -> "Fire":
    """Create a fire that spreads according to the given scheme.

    Args:
        name: The scheme, a key of ``SCHEMES``.
        landscape: Terrain and fuel.
        weather: The weather from 0 s on.
        ignitions: (row, column, time in s) of each cell that is lit.
        burning: An initial fire that the model continues.
        seed: Seed of the random generator, for schemes that use random numbers and for spotting.
        closings: Cells that cannot burn from a given time on (``control_lines``).
        settings: The scheme's ``settings``, by name; omitted settings have their defaults.
            ``spotting`` lets burning crowns emit ``firebrands_per_ha`` (``firebrands``). With
            ``acceleration`` new fires accelerate (``accelerated_fire``).

    Returns:
        The fire, at 0 s or at the time of ``burning``.

    Raises:
        FireModelError: The cell of an ignition cannot burn, or a setting is out of range.
        TypeError: The scheme has no setting of that name.
    """
    import numpy as np

    scheme = SCHEMES[name]
    if scheme.random:
        settings = {"p_spread": P_SPREAD, "update_s": UPDATE_S, **settings}
        settings["rng"] = np.random.default_rng(seed)
    names = [name for name in SPOTTING if name in settings and scheme.emits_firebrands]
    spotting = {name: settings.pop(name) for name in names}
    accelerates = not scheme.random and settings.pop(ACCELERATION, False)
    delay_s = SPOT_FIRE_DELAY_S if accelerates else 0.0
    firebrands = _firebrands(spotting, burning, seed, settings.get("crown", "none"), delay_s)

    def begun(lit: "Sequence[Ignition]", burning: "Burning | None") -> "Fire":
        fire: Fire = getattr(import_module(scheme.module), scheme.fire)(
            landscape, weather, lit, burning, **settings
        )
        fire.firebrands = firebrands
        return fire

    if accelerates:
        from firemodel.spread.accelerated_fire import AcceleratedFire

        unlit, old = begun([], None), None
        if burning is not None:
            unlit.advance(burning.at_s)
            old = begun([], burning)
        found: Fire = AcceleratedFire(unlit, ignitions, old, burning)
    else:
        found = begun(ignitions, burning)
    found.add_closings(closings)
    return found


def _firebrands(
    settings: dict[str, Any],
    burning: "Burning | None",
    seed: int | tuple[int, ...],
    crown: "CrownMethod",
    delay_s: float,
) -> "Firebrands | None":
    """Return the firebrands of a fire; None without spotting."""
    if not settings.get("spotting", False):
        return None
    if crown == "none":
        raise FireModelError(
            "spotting: only burning crowns emit firebrands; set crown, for example to "
            '"scott_reinhardt"'
        )
    from firemodel.spread.firebrands import Firebrands

    return Firebrands(
        settings.get("firebrands_per_ha", FIREBRANDS_PER_HA),
        settings.get("air_temperature_c", AIR_TEMPERATURE_C),
        seed,
        burning.at_s if burning else 0.0,
        delay_s,
    )
