"""Defines the base class of a scenario file's tables, and the types of their values."""

from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidatorFunctionWrapHandler,
    field_validator,
)
from pydantic_core import PydanticKnownError

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=180)]


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("must be one line of printable characters")
    return text


Line = Annotated[str, AfterValidator(_printable)]


class Section(BaseModel):
    """A read-only table of the file; unknown keys, and booleans instead of numbers, are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @field_validator("*", mode="wrap")
    @classmethod
    def _no_boolean_as_number(cls, given: Any, check: ValidatorFunctionWrapHandler) -> Any:
        found = check(given)
        if not _boolean_became_number(given, found):
            return found
        if isinstance(given, bool):
            raise PydanticKnownError("float_type")
        raise ValueError("contains true or false instead of a number")


def _boolean_became_number(given: Any, found: Any) -> bool:
    """Return whether a boolean was converted to a number, also inside lists and tables."""
    if isinstance(given, bool):
        return isinstance(found, int | float) and not isinstance(found, bool)
    if isinstance(given, list | tuple) and isinstance(found, list | tuple):
        return any(map(_boolean_became_number, given, found))
    if isinstance(given, dict) and isinstance(found, dict):
        return any(map(_boolean_became_number, given.values(), found.values()))
    return False
