"""Body entries of a robot file → Body, with an inertia that a body can have."""

from __future__ import annotations

import numpy as np

from ssm_planner.problem.axes import rotation
from ssm_planner.problem.schema.robot import BodyModel, InertiaModel
from ssm_planner.problem.source import Section
from ssm_planner.problem.values import Array, Body, frozen

SLACK = 1e-6
"""Of the triangle inequality, relative to the largest moment: printed figures are rounded."""

LARGEST_GYRATION = 1.0
"""m; a link of a surgical tool is smaller."""


def bodies_from(section: Section, models: list[BodyModel]) -> tuple[Body, Body, Body, Body]:
    """Four bodies; each frame is given relative to the one before it at q = 0. Raises ProblemError."""
    frame = np.eye(3)
    bodies = []
    for i, model in enumerate(models):
        frame = frame @ rotation(model.frame)
        inertia = _inertia(section.sub(i), model)
        bodies.append(
            Body(model.name, model.mass, frozen(model.com, (3,)), frozen(inertia, (3, 3)), frozen(frame, (3, 3)))
        )
    first, second, third, fourth = bodies
    return first, second, third, fourth


def principal_moments(mass: float, com: Array, inertia: Array) -> Array:
    """Principal moments about the centre of mass, ascending, kg·m², (3,); inertia (3, 3) is about the origin."""
    about_com = inertia - mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.asarray(np.linalg.eigvalsh(about_com), dtype=float)


def possible(moments: Array) -> bool:
    """Whether a body can have these principal moments: positive, none above the sum of the other two."""
    low, middle, high = moments
    return bool(low > 0 and high <= low + middle + SLACK * high)


def _tensor(model: InertiaModel, sign: float) -> Array:
    xy, xz, yz = sign * model.xy, sign * model.xz, sign * model.yz
    return np.array([[model.xx, xy, xz], [xy, model.yy, yz], [xz, yz, model.zz]])


def _inertia(section: Section, model: BodyModel) -> Array:
    """The tensor about the frame's origin: products −∫xy dm, whatever sign the file uses."""
    if model.inertia is None:
        if model.mass > 0:
            raise section.error("missing: a body with mass has an inertia", "inertia")
        return np.zeros((3, 3))
    products = any((model.inertia.xy, model.inertia.xz, model.inertia.yz))
    convention = model.products_of_inertia
    if products and convention is None:
        raise section.error(
            "missing: the sign convention of the products of inertia",
            "products_of_inertia",
            allowed="cad (∫xy dm, as CAD programs print) or tensor (−∫xy dm)",
        )
    sign = -1.0 if convention == "cad" else 1.0
    tensor = _tensor(model.inertia, sign)
    if model.mass == 0:
        if np.any(tensor):
            raise section.error("a body without mass has no inertia", "inertia", allowed="zeros, or a mass")
        return tensor
    com = frozen(model.com, (3,))
    moments = principal_moments(model.mass, com, tensor)
    if not possible(moments):
        flipped = principal_moments(model.mass, com, _tensor(model.inertia, -sign))
        raise section.error(_impossible(moments, flipped, convention), "inertia", allowed=_LAW)
    gyration = float(np.sqrt(moments[2] / model.mass))
    if gyration > LARGEST_GYRATION:
        raise section.error(
            f"implausible: a radius of gyration of {gyration:.3g} m; are mass and inertia in the right unit?",
            "inertia",
            allowed=f"a radius of gyration up to {LARGEST_GYRATION:g} m",
        )
    return tensor


_LAW = "principal moments about the centre of mass that are positive, none above the sum of the other two"


def _impossible(moments: Array, flipped: Array, convention: str | None) -> str:
    text = f"no body can have this inertia: its principal moments about the centre of mass are {_list(moments)}"
    if convention is not None:
        other = "tensor" if convention == "cad" else "cad"
        text += f"; the usual cause is the sign of the products of inertia: here products_of_inertia is {convention}"
        if possible(flipped):
            text += f", and with {other} the moments are {_list(flipped)}, which a body can have: try it"
        else:
            text += (
                f", but {other} would not do either; check that it is about the origin of the body frame, and its unit"
            )
    return text


def _list(moments: Array) -> str:
    return "(" + ", ".join(f"{moment:.4g}" for moment in moments) + ") kg*m^2"
