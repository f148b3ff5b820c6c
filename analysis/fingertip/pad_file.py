"""pad.toml: sizes of the finger pad with their sources, materials, loads, mesh; validated once, here."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from analysis.errors import BadInputError

LAYERS = ("epidermis", "dermis", "fat")
"""From the skin to the bone."""
_FASTEST = 0.8
"""Growth of elements that the mesher still makes a mesh with."""
EXAMPLE = "pad.toml"


class _Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Size(_Settings):
    """A length or angle with where it comes from: a citation, or the word ``assumed``."""

    value: float
    source: Annotated[str, Field(min_length=1)]


class Positive(Size):
    """A size above zero."""

    value: Annotated[float, Field(gt=0)]


class Geometry(_Settings):
    """A distal phalanx: a superelliptic tube that ends in half a superellipsoid, layers round a rigid bone.

    The axis runs along z towards the tip, y towards the pad, x sideways; the tube ends at z = 0. The pad is
    pressed where x = 0 and z = ``contact_z_mm``. Layers keep their thickness on the axes of the section.
    The nail holds the skin that lies beyond ``nail_angle_deg`` from the pad's side.
    """

    half_width_mm: Positive
    half_height_mm: Positive
    tip_length_mm: Positive
    tube_length_mm: Positive
    superellipse_exponent: Size
    epidermis_mm: Positive
    dermis_mm: Positive
    bone_half_width_mm: Positive
    bone_half_height_mm: Positive
    bone_tip_mm: Positive
    bone_dorsal_shift_mm: Size
    nail_angle_deg: Positive
    contact_z_mm: Size

    @model_validator(mode="after")
    def _bone_inside(self) -> Self:
        skin_mm = self.epidermis_mm.value + self.dermis_mm.value
        # a twentieth of a millimetre of fat all round: less can't be meshed
        least = 0.05
        room = {
            "sideways": self.half_width_mm.value - skin_mm - self.bone_half_width_mm.value,
            "on the pad's side": self.half_height_mm.value - skin_mm
            - (self.bone_half_height_mm.value - self.bone_dorsal_shift_mm.value),
            "on the nail's side": self.half_height_mm.value - skin_mm
            - (self.bone_half_height_mm.value + self.bone_dorsal_shift_mm.value),
            "at the tip": self.tip_length_mm.value - skin_mm - self.bone_tip_mm.value,
        }  # fmt: skip
        side, left = min(room.items(), key=lambda item: item[1])
        if left < least:
            raise ValueError(
                f"the bone leaves the fat {side}: {left:.3g} mm of fat are left and {least} mm are needed; make "
                "the bone smaller, move it, or make the skin thinner"
            )
        if not 90 < self.nail_angle_deg.value < 180:
            raise ValueError(
                f"nail_angle_deg = {self.nail_angle_deg.value:g}: must lie between 90 and 180 degrees"
            )
        if not 2 <= self.superellipse_exponent.value <= 4:
            raise ValueError(
                f"superellipse_exponent = {self.superellipse_exponent.value:g}: must lie between 2 and 4"
            )
        if not -self.tube_length_mm.value + 1 <= self.contact_z_mm.value <= -0.5:
            raise ValueError(
                f"contact_z_mm = {self.contact_z_mm.value:g}: must lie on the tube, between "
                f"{1 - self.tube_length_mm.value:g} and -0.5 mm"
            )
        return self


class Layer(_Settings):
    """A layer and its Poisson's ratio."""

    nu: Annotated[float, Field(ge=0, lt=0.5)]


class CoreLayer(Layer):
    """A layer of the core, and how stiff it is beside the core's others."""

    relative_modulus: Annotated[float, Field(gt=0)] = 1.0


class Layers(_Settings):
    """The three layers; dermis and fat are the core."""

    epidermis: Layer
    dermis: CoreLayer
    fat: CoreLayer


class Punch(_Settings):
    """The flat punch: its diameter, and whether skin sticks to it."""

    diameter_mm: Annotated[float, Field(gt=0, le=1)] = 0.5
    contact: Literal["bonded", "frictionless"] = "bonded"


class Plate(_Settings):
    """The flat plate: how far it reaches along the finger, half to either side of the point of contact."""

    length_mm: Positive


class Calibration(_Settings):
    """How many Prony terms a viscoelastic layer has."""

    prony_terms: Annotated[int, Field(ge=1, le=6)] = 2


class MeshSettings(_Settings):
    """Size and order of the elements, or a mesh of the user's own in place of the parametric one."""

    # flat elements of order 1 lock where tissue is nearly incompressible, and hold fewer pressures than faces
    order: Annotated[int, Field(ge=2, le=4)] = 3
    size_mm: Annotated[float, Field(gt=0, le=3)] = 0.9
    contact_size_mm: Annotated[float, Field(gt=0, le=0.5)] = 0.0075
    # patches of 0.083 mm under the line need no smaller elements
    line_size_mm: Annotated[float, Field(gt=0, le=0.5)] = 0.06
    grading: Annotated[float, Field(gt=0, lt=1)] = 0.5
    file: Path | None = None
    line_file: Path | None = None
    plate_file: Path | None = None

    @model_validator(mode="after")
    def _file_first(self) -> Self:
        if self.file is None and (self.line_file or self.plate_file):
            raise ValueError(
                "line_file or plate_file without file, the mesh under the punch: give that as well"
            )
        return self

    def file_for(self, load: str) -> Path | None:
        """Return the user's mesh for a load, if the pad is one."""
        return {"line": self.line_file, "plate": self.plate_file}.get(load) or self.file


class PadFile(_Settings):
    """Everything pad.toml says."""

    geometry: Geometry
    layers: Layers
    punch: Punch = Punch()
    plate: Plate = Plate(length_mm=Positive(value=6.0, source="assumed"))
    calibration: Calibration = Calibration()
    mesh: MeshSettings = MeshSettings()

    def relative_moduli(self) -> tuple[float, float, float]:
        """Relaxed moduli beside each other were epidermis and core of one modulus, in the order of `LAYERS`."""
        return 1.0, self.layers.dermis.relative_modulus, self.layers.fat.relative_modulus

    def with_elements(self, factor: float) -> PadFile:
        """Return the same pad on a mesh of elements larger by a factor all over.

        Between load and largest element the growth says how large they are, so that it has to grow as well.
        """
        there = self.mesh
        sizes = {
            name: factor * getattr(there, name) for name in ("size_mm", "contact_size_mm", "line_size_mm")
        } | {"grading": max(there.grading, min(factor * there.grading, _FASTEST))}
        return self.model_copy(update={"mesh": self.mesh.model_copy(update=sizes)})

    def with_order(self, order: int) -> PadFile:
        """Return the same pad on elements of another order."""
        return self.model_copy(update={"mesh": self.mesh.model_copy(update={"order": order})})

    def with_epidermis(self, thickness_mm: float) -> PadFile:
        """Return the same pad with another epidermis, at the dermis' cost; BadInputError where none is left of that."""
        g = self.geometry
        dermis_mm = g.epidermis_mm.value + g.dermis_mm.value - thickness_mm
        if thickness_mm <= 0 or dermis_mm <= 0:
            raise BadInputError(
                f"an epidermis of {thickness_mm:.3g} mm leaves no dermis: make geometry.dermis_mm larger, or the "
                "epidermis thinner"
            )
        new = {
            "epidermis_mm": g.epidermis_mm.model_copy(update={"value": thickness_mm}),
            "dermis_mm": g.dermis_mm.model_copy(update={"value": dermis_mm}),
        }
        geometry = Geometry.model_validate(g.model_copy(update=new).model_dump())
        return self.model_copy(update={"geometry": geometry})


def example_text() -> str:
    """Return the pad.toml that ships: every key, its unit, its source."""
    return files("analysis.fingertip").joinpath(EXAMPLE).read_text(encoding="utf-8")


def read_pad(path: Path | None) -> PadFile:
    """Read pad.toml, or the shipped one where ``path`` is None; BadInputError in one line where it is wrong."""
    name = EXAMPLE if path is None else str(path)
    try:
        text = example_text() if path is None else path.read_text(encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"{path}: can't be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise BadInputError(f"{path}: is not UTF-8 text") from error
    try:
        pad = PadFile.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise BadInputError(f"{name}: not valid TOML: {error}") from error
    except ValidationError as error:
        raise BadInputError(f"{name}: {_one_line(error)}") from error
    if path is None:
        return pad
    # whole, so that the commands that go on from a calibration find them from anywhere
    given = {name: getattr(pad.mesh, name) for name in ("file", "line_file", "plate_file")}
    found = {name: (path.parent / file).resolve() for name, file in given.items() if file is not None}
    return pad.model_copy(update={"mesh": pad.mesh.model_copy(update=found)})


def _one_line(error: ValidationError) -> str:
    first: Any = error.errors(include_url=False)[0]
    key = ".".join(str(part) for part in first["loc"])
    message = str(first["msg"]).removeprefix("Value error, ")
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    if first["type"] == "value_error":
        return f"{key}: {message}{more}"
    if first["type"] == "extra_forbidden":
        return f"unknown key {key!r}: see `indenter fingertip example`{more}"
    if first["type"] == "missing":
        return f"{key} is missing: see `indenter fingertip example`{more}"
    if first["type"] == "model_type":
        return f'{key} = {first["input"]!r}: write it as {{ value = ..., source = "..." }}{more}'
    hint = "; a fully incompressible layer can't be solved, 0.49 can" if key.endswith(".nu") else ""
    return f"{key} = {first['input']!r}: {message[:1].lower()}{message[1:]}{hint}{more}"
