"""Define the standard deviations of the errors in a fire's inputs, with sources."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """The standard deviations of the errors in a fire's inputs.

    All errors are independent and constant during a fire. Factors are log-normal with a median of
    1; angles and distances are normally distributed with a mean of 0.

    Cruz & Alexander 2013 (Environ. Model. Softw. 47, 16-28) compared 1278 rates of spread: the best
    models have an error of 35 %, including errors in the weather. Rates grow with the wind speed to
    a power of 1.2 to 1.6. The standard deviations of the wind speed, of the common factor of the
    spread rates and of the factor of each fuel therefore combine to 0.37. The two factors of the
    spread rates are assumed to have equal standard deviations.

    Models of the moisture of dead grass have a mean error of 1.16 percentage points (Fire 2019,
    2(1), 2); at a moisture of 10 % this corresponds to a standard deviation of 0.15. The standard
    deviations of the wind direction (two thirds of wind directions are within 15 degrees of the
    reported direction) and of the ignition are assumptions without a published source.
    """

    wind_log_sd: float = 0.2  # for the factor of the wind speed
    wind_turn_sd_deg: float = 15.0
    spread_log_sd: float = 0.18  # for the common factor of all spread rates
    fuel_log_sd: float = 0.18  # for a further factor of the spread rate in each fuel
    moisture_log_sd: float = 0.15  # for the factor of dead fuel moisture
    ignition_sd_m: float = 50.0  # for the offset to the north and the offset to the east


# The errors that are assumed in an estimate. The reported wind may be a forecast or come from a
# distant station, and its error includes the effect of local winds. The values are assumptions;
# observations reduce the errors.
UNMEASURED = Uncertainty(wind_log_sd=0.5, wind_turn_sd_deg=30.0, spread_log_sd=0.3)
