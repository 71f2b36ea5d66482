"""List the spread schemes with name, class and settings, and create fires.

A new scheme requires a module and an entry in ``SCHEMES``. Scenario files, experiments and the
command line use this table. The module of a scheme is imported only when a fire is created, because
the module imports Numba.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

if TYPE_CHECKING:
    from firemodel.landscape.landscape import Landscape
    from firemodel.physics.weather import WeatherStream
    from firemodel.spread.fire_scheme import Burning, Fire, Ignition

SchemeName = Literal["anyangle", "devs8", "probabilistic"]


class Scheme(NamedTuple):
    """The ``Fire`` class of a scheme, and the settings of the scheme."""

    module: str
    fire: str  # the name of the class
    settings: tuple[str, ...]  # keyword arguments, and keys of a scenario's table [fire]
    random: bool = False  # True if the class has the argument ``rng``, a random generator


CROWN = ("crown", "foliar_moisture_pct")
SCHEMES: dict[SchemeName, Scheme] = {
    "anyangle": Scheme(
        "firemodel.spread.anyangle", "AnyAngleFire", ("wind_limit", "precise", *CROWN)
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
    **settings: Any,
) -> "Fire":
    """Create a fire that spreads by a scheme.

    Args:
        name: The scheme, a key of ``SCHEMES``.
        landscape: Terrain and fuel.
        weather: The weather from 0 s on.
        ignitions: (row, column, time in s) of each cell that is lit.
        burning: An initial fire that the model continues.
        seed: Seed of the random generator, for schemes that use random numbers.
        settings: The scheme's ``settings``, by name; omitted settings have their defaults.

    Returns:
        The fire, at 0 s or at the time of ``burning``.

    Raises:
        FireModelError: The cell of an ignition cannot burn, or a setting is out of range.
        TypeError: The scheme has no setting of that name, or requires a setting that is not given.
    """
    import numpy as np

    scheme = SCHEMES[name]
    if scheme.random:
        settings["rng"] = np.random.default_rng(seed)
    fire: Fire = getattr(import_module(scheme.module), scheme.fire)(
        landscape, weather, ignitions, burning, **settings
    )
    return fire
