"""What all settings have in common: they are checked when they are made, and unknown keys are refused.

Values given with `--config` arrive as text, so that text stands for a number, a switch or null wherever one is wanted.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Annotated, Any, Literal, Self, TypeVar, cast

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationError,
    model_validator,
)
from pydantic._internal._model_construction import ModelMetaclass  # published under no other name
from pydantic_core import CoreSchema, PydanticCustomError, PydanticKnownError

from gsbridge.configuration.faults import explain

T = TypeVar("T")
ABSENT: Any = None
"""Default of a key of `Given` settings that may stay away."""
_SWITCHES = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
"""The words that YAML takes for a switch."""
_RANGES = {"ge": "minimum", "gt": "exclusiveMinimum", "le": "maximum", "lt": "exclusiveMaximum"}


def fault(problem: str, remedy: str) -> PydanticCustomError:
    """An error for a validator to raise.

    Args:
        problem: What is wrong, in plain words.
        remedy: What the user can do about it.
    """
    return PydanticCustomError("fault", "{problem}", {"problem": problem, "remedy": remedy})


def _number(value: Any) -> Any:
    if isinstance(value, bool):  # to Python they are 0 and 1
        raise PydanticKnownError("float_type")
    return value


def _whole(value: Any) -> Any:
    if isinstance(value, bool):
        raise PydanticKnownError("int_type")
    return value


def _switch(value: Any) -> Any:
    found = _SWITCHES.get(value.lower()) if isinstance(value, str) else value
    if not isinstance(found, bool):
        raise PydanticKnownError("bool_type")
    return found


def _null(value: Any) -> Any:
    return None if isinstance(value, str) and value in ("null", "~") else value


def _digits(value: Any) -> Any:
    return int(value) if isinstance(value, str) and value.isdecimal() else value


def _distinct(values: list[T]) -> list[T]:
    twice = next((value for number, value in enumerate(values) if value in values[:number]), None)
    if twice is not None:
        raise fault(f"'{twice}' stands twice", "Remove one")
    return values


def _numbers(value: Any) -> Any:
    """The settings with numbers for texts that are numbers, in lists and blocks of keys, too."""
    if isinstance(value, dict):
        return {key: _numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_numbers(item) for item in value]
    if isinstance(value, str):
        for kind in (int, float):
            try:
                value = kind(value)
            except ValueError:
                continue
            break
    if isinstance(value, float) and not isfinite(value):
        raise PydanticKnownError("finite_number")
    return value


Whole = Annotated[int, BeforeValidator(_whole)]
"""A whole number."""
Number = Annotated[float, Field(allow_inf_nan=False), BeforeValidator(_number)]
"""A finite number."""
Share = Annotated[float, Field(ge=0, le=1), BeforeValidator(_number)]
"""A number from 0 to 1."""
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False), BeforeValidator(_number)]
"""A finite number above 0."""
Samples = Annotated[int, Field(ge=1, le=4096), BeforeValidator(_whole)]
"""Samples per pixel."""
Pixels = Annotated[int, Field(ge=64, le=4096), BeforeValidator(_whole)]
"""Edge of a picture, px."""
Switch = Annotated[bool, BeforeValidator(_switch)]
"""True or false."""
Always = Annotated[Literal[True], BeforeValidator(_switch)]
"""True, where there is no other choice."""
OrNull = Annotated[T | None, BeforeValidator(_null)]
"""A value or null."""
Distinct = Annotated[list[T], AfterValidator(_distinct), Field(json_schema_extra={"uniqueItems": True})]
"""A list in which nothing stands twice."""
Free = Annotated[Any, BeforeValidator(_numbers)]
"""Any value, which is checked elsewhere."""
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
"""A name that becomes a folder and a wildcard."""
PictureSize = Annotated[Literal[64, 128], BeforeValidator(_digits)]
"""Edge of the square pictures that policies see, px."""
Device = Literal["cpu", "cuda"]
Sheet = Literal["a4", "letter"]
"""Paper size of the printed board."""


def _name_ranges(schema: Any) -> None:
    """Give ranges their names in JSON schemas, in place: behind a validator pydantic leaves them their own."""
    for item in schema if isinstance(schema, list) else schema.values() if isinstance(schema, dict) else ():
        _name_ranges(item)
    if isinstance(schema, dict):
        for name in _RANGES.keys() & schema.keys():
            schema[_RANGES[name]] = schema.pop(name)


class _Told(ModelMetaclass):
    """Makes settings that say what is wrong with them in one line."""

    def __call__(cls, *args: Any, **values: Any) -> Any:  # noqa: N805  (what it makes are classes)
        """Settings from their values.

        Raises:
            InputError: A key is unknown or missing, or a value has a wrong type or range; names the key.
        """
        try:
            return super().__call__(*args, **values)
        except ValidationError as error:
            model = cast(type[BaseModel], cls)
            raise explain(model, error, cls.__name__.removesuffix("Settings").lower()) from error


class Settings(BaseModel, metaclass=_Told):
    """Base of all settings."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, defer_build=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        """Take the line breaks out of the keys' descriptions, and the full stop: they stand in errors and tables."""
        for field in cls.model_fields.values():
            field.description = " ".join((field.description or "").split()).removesuffix(".")

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        schema = handler.resolve_ref_schema(handler(core))
        _name_ranges(schema)
        return schema


S = TypeVar("S", bound=Settings)


def checked(model: type[S], values: Mapping[str, Any], source: str) -> S:
    """Settings from what a user gave.

    Args:
        model: Kind of the settings.
        values: Values of the settings.
        source: Where they were given, such as `config`, for the message.

    Raises:
        InputError: A key is unknown or missing, or a value has a wrong type or range; names the key.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise explain(model, error, source) from error


class Given(Settings):
    """Base of settings whose keys stay away where they are not given, instead of taking a default."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        schema = super().__get_pydantic_json_schema__(core, handler)
        for content in schema.get("properties", {}).values():
            content.pop("default", None)
        return schema


class OneOf(Given):
    """Base of settings of which exactly one key is given."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    @model_validator(mode="after")
    def _one_is_given(self) -> Self:
        if len(self.model_fields_set) != 1:
            given = ", ".join(key for key in type(self).model_fields if key in self.model_fields_set) or "none"
            remedy = f"Keep one of: {', '.join(type(self).model_fields)}"
            raise fault(f"exactly one of these is wanted, and {given} given", remedy)
        return self


def override(section: type[Settings]) -> type[Given]:
    """Settings with the keys and ranges of a section, none of which need be given: the others stay as they are."""
    # Its fields bring their descriptions along; to look for them in the source once more would take a tenth of a second.
    content = {"__doc__": section.__doc__, "__module__": __name__, "model_config": ConfigDict(use_attribute_docstrings=False)}
    return type(f"{section.__name__}Override", (Given, section), content)


def plain(value: Any) -> Any:
    """Settings as YAML would give them: blocks of keys, lists and scalars, without the keys that were not given to `Given`."""
    if isinstance(value, Settings):
        keys = [key for key in type(value).model_fields if not isinstance(value, Given) or key in value.model_fields_set]
        return {key: plain(getattr(value, key)) for key in keys}
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value
