# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads a Blender material into closures: dictionaries as skytree_core.Scene.add_material takes them.

Colours and factors that vary over an image become textures; what the renderer has no closure for is reported
once with the material's name and what is shown instead.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ..brdf_tables import brdf_spec
from ..images import ImageStore
from ..messages import Messages
from ..version import uses_nodes
from . import expression as ex
from .reader import NodeReader, Place, active_output, follow
from .textures import TextureReader

DEFAULT_COLOR = (0.8, 0.8, 0.8)
MAX_CLOSURES = 8
MIN_WEIGHT = 1e-5
MIN_WARD_ALPHA = 0.001


@dataclass
class MaterialClosures:
    """Closures whose `..._texture` values are TextureSpecs still to be uploaded, and the UV layer they
    want."""

    closures: list[dict] = field(default_factory=list)
    uv_map: str = ""


def default_material() -> MaterialClosures:
    return MaterialClosures([{"type": "DIFFUSE", "color": DEFAULT_COLOR}])


def read_material(material, store: ImageStore, messages: Messages) -> MaterialClosures:
    """`material` is evaluated, or None for an empty slot (Blender's default grey)."""
    if material is None:
        return default_material()
    settings = getattr(material, "skytree", None)
    if settings is not None and settings.use_table:
        return MaterialClosures(
            [
                {
                    "type": "TABULATED",
                    "weight": 1.0,
                    "brdf": brdf_spec(material),
                    "color": tuple(settings.table_color),
                    "rotation": settings.table_rotation,
                }
            ]
        )
    if settings is not None and settings.use_ward:
        return MaterialClosures(
            [
                {
                    "type": "WARD",
                    "color": tuple(settings.ward_color),
                    "rotation": settings.ward_rotation,
                    "alpha_x": max(settings.ward_alpha_x, MIN_WARD_ALPHA),
                    "alpha_y": max(settings.ward_alpha_y, MIN_WARD_ALPHA),
                }
            ]
        )
    if not uses_nodes(material):
        return MaterialClosures([{"type": "DIFFUSE", "color": tuple(material.diffuse_color)[:3]}])
    return _MaterialReader(material, store, messages).read(material.node_tree)


class _MaterialReader:
    def __init__(self, material, store: ImageStore, messages: Messages):
        self.owner = f'Material "{material.name}"'
        self.messages = messages
        self.textures = TextureReader(self.owner, store, messages)
        self.reader = NodeReader(self.owner, messages, self.textures.image_leaf, camera_ray=1.0)
        self.closures: list[dict] = []

    def read(self, tree) -> MaterialClosures:
        output = active_output(tree, "OUTPUT_MATERIAL")
        if output is None:
            self.warn("has no Material Output; it is shown black")
            return MaterialClosures()
        for name in ("Volume", "Displacement"):
            if any(link.is_valid and not link.is_muted for link in output.inputs[name].links):
                self.warn(f"{name.lower()} is left out")
        surface = Place(output.inputs["Surface"])
        if follow(surface)[0] is None:
            self.warn("nothing is linked to the Surface; it is shown black")
        self._closure(surface, 1.0)
        closures = [c for c in self.closures if c["weight"] > MIN_WEIGHT]
        if len(closures) > MAX_CLOSURES:
            self.warn(f"has {len(closures)} shaders; the {MAX_CLOSURES} of largest weight are shown")
            closures = sorted(closures, key=lambda c: -c["weight"])[:MAX_CLOSURES]
        return MaterialClosures(closures, self.textures.uv_map or "")

    def warn(self, text: str):
        self.messages.warn(f"{self.owner}: {text}")

    def _closure(self, place: Place, weight: float):
        output, _ = follow(place)
        if output is None or weight <= MIN_WEIGHT:
            return
        node = output.node
        handler = getattr(self, "_" + node.type.lower(), None) if output.socket.type == "SHADER" else None
        if handler:
            handler(output, weight)
        elif output.socket.type != "SHADER":
            color = self._color_of(place, self.reader.output(output))
            self._add("EMISSION", weight, strength=1.0, **color)
        else:
            self.warn(
                f'the shader "{node.name}" ({node.bl_label}) is not known; a diffuse surface of its colour '
                "is shown instead"
            )
            color = output.input("Color") or output.input("Base Color")
            self._add("DIFFUSE", weight, **(self._color(color) if color else {"color": DEFAULT_COLOR}))

    def _add(self, kind: str, weight: float, **parameters):
        self.closures.append({"type": kind, "weight": weight, **parameters})

    # Inputs

    def _color(self, place: Place, name: str = "color") -> dict:
        return self._color_of(place, self.reader.value(place), name)

    def _color_of(self, place: Place, value, name: str = "color") -> dict:
        if value is None:
            return {name: DEFAULT_COLOR}
        scale, rest = ex.split_scale(value)
        if isinstance(rest, ex.Constant):
            return {name: scale}
        return {name: (1.0, 1.0, 1.0), f"{name}_texture": self.textures.spec(value)}

    def _scalar(self, place: Place | None, name: str, default: float = 0.0) -> dict:
        """A scalar that the core can take from a texture."""
        if place is None:
            return {name: default}
        value = ex.scalar(self.reader.value(place))
        if isinstance(value, ex.Constant):
            return {name: value.values[0]}
        return {name: 1.0, f"{name}_texture": self.textures.spec(value)}

    def _number(self, output: Place, *identifiers: str, default: float = 0.0) -> float:
        """A scalar that has to be constant; the first identifier that this Blender's node has."""
        place = next((p for p in map(output.input, identifiers) if p), None)
        return self.reader.number(place, default)

    def _normal(self, output: Place) -> dict:
        place = output.input("Normal")
        source = follow(place)[0] if place else None
        if source is None:
            return {}
        node = source.node
        if node.type == "NORMAL_MAP" and node.space == "TANGENT":
            value = self.reader.value(source.input("Color"))
            if isinstance(value, ex.Constant):
                return {}
            strength = self.reader.number(source.input("Strength"), 1.0)
            self.textures.want_uv(node.uv_map)
            return {"normal_texture": self.textures.spec(value), "normal_strength": strength}
        self.warn(f'the normal from "{node.name}" ({node.bl_label}) is left out; the surface stays smooth')
        return {}

    def _tangent(self, output: Place):
        place = output.input("Tangent")
        source = follow(place)[0] if place else None
        if source is None:
            return
        node = source.node
        if node.type == "TANGENT" and node.direction_type == "UV_MAP":
            self.textures.want_uv(node.uv_map)
        elif not (node.type == "TANGENT" and node.direction_type == "RADIAL" and node.axis == "Z"):
            self.warn(f'the tangent from "{node.name}" ({node.bl_label}) is read as radial about Z')

    # Shaders, by node type

    def _mix_shader(self, output: Place, weight: float):
        factor = min(max(self._number(output, "Fac", default=0.5), 0.0), 1.0)
        first, second = (Place(s, output.groups) for s in list(output.node.inputs)[-2:])
        self._closure(first, weight * (1.0 - factor))
        self._closure(second, weight * factor)

    def _add_shader(self, output: Place, weight: float):
        for socket in output.node.inputs:
            self._closure(Place(socket, output.groups), weight)

    def _bsdf_diffuse(self, output: Place, weight: float):
        self._add(
            "DIFFUSE",
            weight,
            **self._color(output.input("Color")),
            **self._scalar(output.input("Roughness"), "roughness"),
            **self._normal(output),
        )

    def _bsdf_glossy(self, output: Place, weight: float):
        node = output.node
        roughness = self._scalar(output.input("Roughness"), "roughness")
        if node.distribution == "SHARP":
            roughness = {"roughness": 0.0}
        elif node.distribution not in {"GGX", "MULTI_GGX"}:
            self.warn(
                f'the distribution {node.distribution.replace("_", "-").title()} of "{node.name}" '
                "is shown as GGX"
            )
        elif node.distribution == "MULTI_GGX":
            self.messages.info(f'{self.owner}: "{node.name}" is shown as GGX with single scattering')
        self._tangent(output)
        self._add(
            "GLOSSY",
            weight,
            **self._color(output.input("Color")),
            **roughness,
            anisotropy=self._number(output, "Anisotropy"),
            rotation=self._number(output, "Rotation"),
            **self._normal(output),
        )

    _bsdf_anisotropic = _bsdf_glossy

    def _emission(self, output: Place, weight: float):
        self._add(
            "EMISSION",
            weight,
            **self._color(output.input("Color")),
            strength=self._number(output, "Strength", default=1.0),
        )

    def _bsdf_transparent(self, output: Place, weight: float):
        self._add("TRANSPARENT", weight, **self._color(output.input("Color")))

    def _holdout(self, output: Place, weight: float):
        self.warn("Holdout is shown black")

    def _bsdf_principled(self, output: Place, weight: float):
        alpha = min(max(self._number(output, "Alpha", default=1.0), 0.0), 1.0)
        if alpha < 1.0:
            self._add("TRANSPARENT", weight * (1.0 - alpha), color=(1.0, 1.0, 1.0))
        for label, *names in (
            ("Transmission", "Transmission", "Transmission Weight"),
            ("Subsurface", "Subsurface", "Subsurface Weight"),
            ("Sheen", "Sheen", "Sheen Weight"),
            ("Coat", "Clearcoat", "Coat Weight"),
            ("Thin Film", "Thin Film Thickness"),
        ):
            if self._number(output, *names) > 0.0:
                self.warn(f'{label} of "{output.node.name}" is left out; its other layers are shown')
        self._tangent(output)
        parameters = {
            **self._color(output.input("Base Color")),
            **self._scalar(output.input("Metallic"), "metallic"),
            **self._scalar(output.input("Roughness"), "roughness"),
            **self._normal(output),
            "anisotropic": self._number(output, "Anisotropic"),
            "rotation": self._number(output, "Anisotropic Rotation"),
        }
        parameters["specular"] = self._number(output, "Specular", "Specular IOR Level", default=0.5)
        if output.input("Specular IOR Level"):
            parameters["ior"] = self._number(output, "IOR", default=1.5)
        self._add("PRINCIPLED", weight * alpha, **parameters)
        strength = self._number(output, "Emission Strength")
        if strength > 0.0:
            color = output.input("Emission Color") or output.input("Emission")
            emission = self._color(color)
            if any(emission["color"]):
                self._add("EMISSION", weight * alpha, strength=strength, **emission)
