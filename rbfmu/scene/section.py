"""The base class of a scene's tables, which finds unknown and exclusive keys and reports all faults at once."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from rbfmu.scene.fields import Rule, SceneError, closest, fault, joined, shown


class Section(BaseModel):
    """A table of the scene: immutable, compared by value; an invalid one raises SceneError with all of its faults."""

    model_config = ConfigDict(frozen=True, defer_build=True)
    _path: ClassVar[str] = ""
    _spellings: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    _other_keys: ClassVar[Mapping[str, tuple[Rule | None, str]]] = {}
    """The rule (None for a table) and the meaning of each key that is not a field."""
    _homes: ClassVar[dict[str, str]] = {}

    def __init__(self, /, **data: Any) -> None:
        faults = list(self._unknown_keys(data))
        values = self._resolved({key: value for key, value in data.items() if key in self._keys()}, faults)
        try:
            super().__init__(**values)
        except ValidationError as error:
            faults += [self._in_words(entry) for entry in error.errors(include_url=False)]
        if not faults:
            faults += self._contradictions()
        if faults:
            raise SceneError(faults)

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Record the table of each key, so that an error can name it where the key is misplaced."""
        for key in cls._keys() if cls._path else ():
            cls._homes.setdefault(key, joined(cls._path, key))

    def _set(self) -> dict[str, Any]:
        """Return the fields that are not as by default."""
        fields = type(self).model_fields
        return {name: getattr(self, name) for name in fields if getattr(self, name) != fields[name].default}

    def __repr_args__(self) -> Iterable[tuple[str | None, Any]]:
        return self._set().items()

    @classmethod
    def read(cls, value: Any) -> Self:
        """Return the section of a table, or the section itself."""
        if isinstance(value, cls):
            return value
        if not isinstance(value, Mapping):
            raise SceneError([fault(cls._path, value, f"a table with keys out of {', '.join(cls._keys())}")])
        return cls(**{str(key): item for key, item in value.items()})

    @classmethod
    def _keys(cls) -> list[str]:
        """Return the keys as the file spells them; several keys may stand for one field."""
        return [key for name in cls.model_fields for key in cls._spellings.get(name, (name,))]

    @classmethod
    def _rule(cls, name: str) -> Rule:
        return next(rule for rule in cls.model_fields[name].metadata if isinstance(rule, Rule))

    @classmethod
    def _resolved(cls, data: dict[str, Any], faults: list[str]) -> dict[str, Any]:
        """Return the fields, made from the keys that stand for them."""
        return data

    def _contradictions(self) -> Iterable[str]:
        """Return the contradictions between fields that are valid by themselves."""
        return ()

    @classmethod
    def _unknown_keys(cls, data: Mapping[str, Any]) -> Iterator[str]:
        keys = cls._keys()
        for key, value in data.items():
            if key not in keys:
                path = joined(cls._path, key)
                near = cls._homes.get(key, path)
                near = closest(key, keys) if near == path else near
                hint = f"did you mean {near}?" if near else f"expected one of {', '.join(keys)}"
                yield f"{path} = {shown(value)}: unknown key; {hint}"

    @classmethod
    def _in_words(cls, error: Mapping[str, Any]) -> str:
        name = str(error["loc"][0])
        path = joined(cls._path, name)
        if error["type"] == "missing":
            return f"{path} is missing: expected {cls._rule(name).expected()}"
        return fault(path, error["input"], str(error["ctx"]["error"]))


def one_of(section: type[Section], data: dict[str, Any], keys: tuple[str, ...], faults: list[str]) -> str:
    """Return the exclusive key that is given, or an empty string; several keys add a fault."""
    given = [key for key in keys if key in data]
    if len(given) > 1:
        path = joined(section._path, given[1])
        faults.append(fault(path, data[given[1]], f"{' or '.join(given)}, not {'both' if len(given) == 2 else 'all'}"))
    return given[0] if len(given) == 1 else ""
