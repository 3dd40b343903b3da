"""Evaluate the rigid-body dynamics of the four bodies: τ = M(q) q̈ + C(q, q̇) q̇ + g(q).

τ are the efforts of the joints, that is, torques of the three revolute joints and the force of the
sliding joint. M is the mass matrix, C q̇ the Coriolis and centrifugal effort, and g the effort of
gravity. All symbolic and numeric results come from one Newton–Euler recursion about the remote
centre of motion (RCM), which is written in CasADi. The main entry is `RigidBody`.
"""

import pickle
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from operator import is_
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen import Layout, call
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import casadi_constant, rotation, rotation_symbolic
from ssm_planner.problem import Body, Geometry, Robot, read_only_array
from ssm_planner.typing import Array, record


def _newton_euler(
    axes: Sequence[Any],
    rotations: Sequence[ca.SX],
    bodies: Sequence[tuple[Any, Any, Any]],
    *,
    base: Any,
    motion: tuple[ca.SX, ca.SX, ca.SX],
) -> ca.SX:
    """Compute the joint efforts of a motion by the Newton–Euler recursion.

    The arguments can be constants or symbols. Each body has a frame that moves with it, in which
    its vectors are constant. The origin of all frames is the RCM, through which all three revolute
    axes pass. Body 4 slides along the third axis and has the frame of body 3.

    Parameters
    ----------
    axes : three of (3,)
        Unit vector of each revolute axis in the frame of the body that turns about it.
    rotations : three of (3, 3)
        Rotation of the frame of each revolute body relative to that of the previous body (or of the
        base). It converts vectors from the frame of the body to the previous one.
    bodies : four of (mass, com, inertia)
        Mass, centre of mass (3,) at q = 0 and inertia about it (3, 3) in the frame of the body. A
        body that only rotates may instead have None, its first moment and its inertia about the
        RCM.
    base : (3,)
        Acceleration of the base, which is −g with the acceleration of gravity g.
    motion : three of (4,)
        Joint positions q, velocities qd and accelerations qdd in rad, rad/s and rad/s² (joint 4: m,
        m/s and m/s²).

    Returns
    -------
    (4,) expression
        Efforts of the joints, N·m, and N for the sliding joint.
    """
    q, qd, qdd = motion
    omega = ca.SX.zeros(3)
    omega_dot = ca.SX.zeros(3)
    base_acceleration = ca.SX(base)
    moments = []
    for i, (mass, com, inertia) in enumerate(bodies):
        sliding = ca.SX.zeros(3)
        position = com
        if i < 3:
            # The vectors are converted to the frame of the next body. The term ω × (axis q̇) is
            # added to ω̇ because the axis turns with the previous bodies.
            back = rotations[i].T
            omega = back @ omega
            omega_dot = back @ omega_dot
            base_acceleration = back @ base_acceleration
            omega_dot = omega_dot + axes[i] * qdd[i] + ca.cross(omega, axes[i]) * qd[i]
            omega = omega + axes[i] * qd[i]
        else:
            position = com + axes[2] * q[3]
            sliding = axes[2] * qdd[3] + 2 * ca.cross(omega, axes[2]) * qd[3]
        moment = inertia @ omega_dot + ca.cross(omega, inertia @ omega)
        if mass is None:
            moments.append(moment + ca.cross(com, base_acceleration))
            continue
        tangential = ca.cross(omega_dot, position)
        centripetal = ca.cross(omega, ca.cross(omega, position))
        force = mass * (base_acceleration + sliding + tangential + centripetal)
        moments.append(moment + ca.cross(position, force))
    tau = [ca.dot(axes[2], force)]
    total = moments[2] + moments[3]  # body 4 turns with body 3
    tau.append(ca.dot(axes[2], total))
    for i in (1, 0):
        total = moments[i] + rotations[i + 1] @ total
        tau.append(ca.dot(axes[i], total))
    return ca.vertcat(*reversed(tau))


LOAD_LAYOUT = Layout(
    first_turn=2, second_turn=2, gravity=3, first_moments=9, inertias=18, mass=1, com=3
)
"""Numbers that determine the efforts of a robot, in the frames of `axis_frames`.

`first_turn` and `second_turn` are the cosine and the sine of the angles between adjacent axes.
`gravity` is the acceleration of gravity in the base frame. `first_moments` and `inertias` (xx, xy,
xz, yy, yz, zz) are those of the three rotating bodies about the RCM. The third inertia includes the
fourth body. `mass` and `com` are the mass and the centre of mass of the fourth body.
"""


def axis_frames(omegas: Sequence[Array]) -> tuple[Array, list[float], float]:
    """Return frames that are aligned with the joint axes.

    The z axis of each frame is a joint axis, and its x–z plane contains the next axis.

    Parameters
    ----------
    omegas : three of (3,)
        Unit vectors of the revolute axes.

    Returns
    -------
    frames : (4, 3, 3)
        Frames of the base and three bodies at q = 0 in the base frame.
    angles : list of float
        Angles between adjacent axes, rad.
    offset : float
        Angle in rad that must be added to θ2, because joint 2 turns the third axis into the x–z
        plane.
    """
    axis_1, axis_2, axis_3 = [np.asarray(omega) / np.linalg.norm(omega) for omega in omegas]
    angles = []
    for axis, next_axis in ((axis_1, axis_2), (axis_2, axis_3)):
        sine = np.linalg.norm(np.cross(axis, next_axis))
        angles.append(float(np.arctan2(sine, axis @ next_axis)))
    x = axis_2 - axis_1 * (axis_1 @ axis_2)
    x /= np.linalg.norm(x)
    frame_1 = np.column_stack([x, np.cross(axis_1, x), axis_1])
    y_axis = np.array([0.0, 1.0, 0.0])
    # Tilted by the first angle, z is the second axis. Turned about it, x–z contains the third axis.
    tilted = frame_1 @ rotation(y_axis, angles[0])
    components = tilted.T @ axis_3
    offset = float(np.arctan2(components[1], components[0]))
    frame_2 = tilted @ rotation(np.array([0.0, 0.0, 1.0]), offset)
    frame_3 = frame_2 @ rotation(y_axis, angles[1])
    return np.stack([frame_1, frame_1, frame_2, frame_3]), angles, offset


def load_parameters(geometry: Geometry, bodies: tuple[Body, ...], gravity: Array) -> Array:
    """Compute the numbers that determine the efforts of a robot.

    They form the vector of `LOAD_LAYOUT`.

    Functions that are compiled once for several robots take these numbers as an argument.

    Parameters
    ----------
    geometry : Geometry
        Geometry with the joint axes.
    bodies : tuple of Body
        The four bodies.
    gravity : (3,) array
        Acceleration of gravity in the base frame, m/s².

    Returns
    -------
    (38,) array
        Numbers in the order of `LOAD_LAYOUT`, in SI units.
    """
    frames, angles, _ = axis_frames((geometry.omega1, geometry.omega2, geometry.omega3))
    coms = [body.frame @ body.com for body in bodies]
    inertias = [body.frame @ body.inertia @ body.frame.T for body in bodies]
    inertias[2] = inertias[2] + bodies[3].frame @ inertia_about_com(bodies[3]) @ bodies[3].frame.T
    first_moments = []
    upper_triangles = []
    for i in range(3):
        frame = frames[i + 1]
        first_moments.append(bodies[i].mass * frame.T @ coms[i])
        upper_triangles.append((frame.T @ inertias[i] @ frame)[np.triu_indices(3)])
    return LOAD_LAYOUT.pack(
        first_turn=[np.cos(angles[0]), np.sin(angles[0])],
        second_turn=[np.cos(angles[1]), np.sin(angles[1])],
        gravity=frames[0].T @ gravity,
        first_moments=first_moments,
        inertias=upper_triangles,
        mass=bodies[3].mass,
        com=frames[3].T @ coms[3],
    )


def efforts_from_parameters(inertias: ca.SX, q: ca.SX, qd: ca.SX, qdd: ca.SX) -> ca.SX:
    """Build the expressions of the joint efforts of a robot that is given by numbers.

    Parameters
    ----------
    inertias : (38,) expression
        Numbers of the robot in the order of `LOAD_LAYOUT`.
    q, qd, qdd : (4,) expressions
        Joint positions, velocities and accelerations in rad, rad/s and rad/s² (joint 4: m, m/s and
        m/s²). The second position must include the offset that `axis_frames` returns.

    Returns
    -------
    (4,) expression
        Efforts of the joints, N·m, and N for the sliding joint.
    """
    f = LOAD_LAYOUT.unpack(inertias)
    axis = casadi_constant(np.array([0.0, 0.0, 1.0]))
    turn = [rotation_symbolic(np.array([0.0, 0.0, 1.0]), q[i]) for i in range(3)]
    turns = [_rotation_about_y(f.first_turn), _rotation_about_y(f.second_turn)]
    bodies: list[tuple[Any, Any, Any]] = []
    for i in range(3):
        xx, xy, xz, yy, yz, zz = ca.vertsplit(f.inertias[6 * i : 6 * i + 6])
        inertia = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
        bodies.append((None, f.first_moments[3 * i : 3 * i + 3], inertia))
    bodies.append((f.mass, f.com, ca.SX(3, 3)))
    rotations = [turn[0], turns[0] @ turn[1], turns[1] @ turn[2]]
    return _newton_euler([axis] * 3, rotations, bodies, base=-f.gravity, motion=(q, qd, qdd))


def _rotation_about_y(turn: ca.SX) -> ca.SX:
    """Build the matrix of a rotation about y.

    Parameters
    ----------
    turn : (2,) expression
        Cosine and sine of the angle.

    Returns
    -------
    (3, 3) expression
        Rotation matrix.
    """
    cosine, sine = ca.vertsplit(turn)
    matrix = ca.SX(3, 3)
    matrix[0, 0] = cosine
    matrix[0, 2] = sine
    matrix[1, 1] = 1.0
    matrix[2, 0] = -sine
    matrix[2, 2] = cosine
    return matrix


def static_loads(axes: Array, masses: Array, coms: Array, gravity: Array, q: Array) -> Array:
    """Compute the efforts that hold several robots at rest against gravity.

    Parameters
    ----------
    axes : (n, 3, 3)
        Unit vectors of the revolute joints of n robots in rows, in the base frame at q = 0.
    masses : (n, 4)
        Masses of the bodies, kg.
    coms : (n, 4, 3)
        Centres of mass in the base frame at q = 0, m.
    gravity : (3,)
        Acceleration of gravity in the base frame, m/s².
    q : (n, k, 4)
        Joint positions in k configurations of each robot, rad, and m for joint 4.

    Returns
    -------
    (n, k, 4) array
        Efforts, N·m, and N for the sliding joint.
    """
    points = q.shape[1]
    robots = np.concatenate([axes.reshape(-1, 9), masses, coms.reshape(-1, 12)], axis=1)
    repeated = np.repeat(robots, points, axis=0)
    loads = call(_static_load_function(tuple(gravity)), q.reshape(-1, 4), repeated)[0]
    return loads.reshape(-1, points, 4)


@lru_cache(maxsize=4)
def _static_load_function(gravity: tuple[float, ...]) -> ca.Function:
    """Build the function that returns the efforts that hold a robot at rest against gravity.

    Parameters
    ----------
    gravity : three floats
        Acceleration of gravity in the base frame, m/s².

    Returns
    -------
    ca.Function
        Function of q (4,) and of 25 numbers of a robot: its three axes (9 numbers), four masses,
        and four centres of mass (12 numbers). It returns the efforts (4,).
    """
    q = ca.SX.sym("q", 4)
    robot = ca.SX.sym("robot", 25)
    zero = ca.SX.zeros(4)
    axes = [robot[3 * i : 3 * i + 3] for i in range(3)]
    hats = [ca.skew(axis) for axis in axes]
    # Rodrigues' formula with a symbolic axis
    rotations = [
        ca.SX.eye(3) + hat * ca.sin(q[i]) + hat @ hat * (1 - ca.cos(q[i]))
        for i, hat in enumerate(hats)
    ]
    bodies = [(robot[9 + i], robot[13 + 3 * i : 16 + 3 * i], ca.SX.zeros(3, 3)) for i in range(4)]
    load = _newton_euler(axes, rotations, bodies, base=-ca.DM(gravity), motion=(q, zero, zero))
    return ca.Function("static_load", [q, robot], [load])


def inertia_about_com(body: Body) -> Array:
    """Compute the inertia tensor of a body about its centre of mass.

    The tensor follows from the one about the origin by the parallel-axis theorem.

    Parameters
    ----------
    body : Body
        Body with its mass, its centre of mass and its inertia about the origin.

    Returns
    -------
    (3, 3) array
        Inertia tensor in the body frame, kg·m².
    """
    c = body.com
    return body.inertia - body.mass * (c @ c * np.eye(3) - np.outer(c, c))


@record
class RigidBody:
    """Numeric rigid-body dynamics of one robot for many samples at once.

    Its CasADi functions are built when they are first used. `from_robot` builds the object.
    """

    geometry: Geometry
    bodies: tuple[Body, ...]
    gravity: Array
    """Acceleration of gravity (3,) in the base frame, m/s²."""

    @classmethod
    def from_robot(cls, robot: Robot) -> "RigidBody":
        """Return the dynamics of a robot.

        Robots with equal geometry, bodies and gravity share one object, so that its CasADi
        functions are built only once.

        Parameters
        ----------
        robot : Robot
            Robot with its geometry, bodies and gravity.

        Returns
        -------
        RigidBody
            Dynamics of the robot. At most 16 different ones are kept.
        """
        global _latest_dynamics
        # Each robot has its own copy of the gravity array.
        key = (robot.geometry,) + tuple(robot.bodies)
        gravity = robot.gravity.tobytes()
        if (
            _latest_dynamics is None
            or _latest_dynamics[1] != gravity
            or not all(map(is_, _latest_dynamics[0], key))
        ):
            content = pickle.dumps((robot.geometry, robot.bodies, robot.gravity))
            _latest_dynamics = key, gravity, _cached_dynamics(content)
        return _latest_dynamics[2]

    def inverse_dynamics(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Compute the joint efforts that produce a motion, for many samples.

        The efforts are τ = M(q) q̈ + C(q, q̇) q̇ + g(q).

        M is the mass matrix, C q̇ the Coriolis and centrifugal effort, and g the effort of gravity.

        Parameters
        ----------
        q, qd, qdd : (n, 4) array
            Joint positions q, velocities q̇ and accelerations q̈ in rad, rad/s and rad/s² (joint 4:
            m, m/s and m/s²).

        Returns
        -------
        (n, 4) array
            Efforts τ (N·m, and N for the sliding joint).
        """
        return call(self._inverse_dynamics, q, qd, qdd)[0]

    def gravity_load(self, q: Array) -> Array:
        """Compute the efforts g(q) that hold the robot at rest against gravity.

        Parameters
        ----------
        q : (n, 4) array
            Joint positions (rad, and m for joint 4).

        Returns
        -------
        (n, 4) array
            Efforts (N·m, and N for the sliding joint).
        """
        zero = np.zeros_like(q)
        return self.inverse_dynamics(q, zero, zero)

    def path_load(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array]:
        """Compute the coefficients of the joint efforts along a path q(s).

        With q̇ = q' ṡ and q̈ = q' s̈ + q'' ṡ², where ' is the derivative with respect to s, the
        efforts are

            τ = a s̈ + b ṡ² + c,   a = M q',   b = M q'' + C(q, q') q',   c = g(q)

        (Bobrow, Dubowsky and Gibson, Time-Optimal Control of Robotic Manipulators Along Specified
        Paths, 1985). TOPP-RA needs the efforts in this form.

        Parameters
        ----------
        q : (n, 4) array
            Joint positions on the path (rad, and m for joint 4).
        dq, ddq : (n, 4) array
            First and second derivatives q' and q'' with respect to s.

        Returns
        -------
        a, b, c : (n, 4) arrays
            Coefficients.
        """
        a, b, c = call(self._path_load, q, dq, ddq)
        return a, b, c

    def effort_parts(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array]:
        """Compute the three parts of the joint efforts: inertia, velocity and gravity.

        Parameters
        ----------
        q, qd, qdd : (n, 4) array
            Joint positions q, velocities q̇ and accelerations q̈ in rad, rad/s and rad/s² (joint 4:
            m, m/s and m/s²).

        Returns
        -------
        inertia, velocity, gravity : (n, 4) arrays
            M(q) q̈, C(q, q̇) q̇ and g(q) (N·m, and N for the sliding joint).
        """
        inertia, velocity, gravity = call(self._effort_parts, q, qd, qdd)
        return inertia, velocity, gravity

    def mass_matrix(self, q: Array) -> Array:
        """Compute the symmetric mass matrix M(q), which relates accelerations to efforts.

        Parameters
        ----------
        q : (n, 4) array
            Joint positions (rad, and m for joint 4).

        Returns
        -------
        (n, 4, 4) array
            Mass matrices (kg·m², kg·m and kg).
        """
        return call(self._mass_matrix, q)[0].reshape(-1, 4, 4)

    def symbolic(self, q: ca.SX, qd: ca.SX, qdd: ca.SX) -> ca.SX:
        """Build CasADi expressions of the joint efforts that produce a given motion.

        The recursion is Newton–Euler with moments about the RCM (Murray, Li, Sastry, ch. 4). All
        three revolute axes pass through the origin, so bodies 1 to 3 only rotate. Body 4 slides
        along ω3, the third axis. Each body has a frame that moves with it and equals the base frame
        at q = 0. In this frame, axes, centres of mass and inertias are constant. Gravity enters as
        an acceleration −g of the base.

        Parameters
        ----------
        q, qd, qdd : (4,) expressions
            Joint positions, velocities and accelerations in rad, rad/s and rad/s² (joint 4: m, m/s
            and m/s²).

        Returns
        -------
        (4,) expression
            Efforts of the joints, N·m, and N for the sliding joint.
        """
        omegas = self.geometry.axes[:3]
        axes = [casadi_constant(omega) for omega in omegas]
        rotations = [rotation_symbolic(omega, q[i]) for i, omega in enumerate(omegas)]
        bodies = []
        for body in self.bodies:
            com = casadi_constant(body.frame @ body.com)
            inertia = casadi_constant(body.frame @ inertia_about_com(body) @ body.frame.T)
            bodies.append((body.mass, com, inertia))
        base = ca.DM(-self.gravity)
        return _newton_euler(axes, rotations, bodies, base=base, motion=(q, qd, qdd))

    @cached_property
    def _inverse_dynamics(self) -> ca.Function:
        """Function of q, qd and qdd that returns the joint efforts."""
        names = ["q", "qd", "qdd"]
        motion = [ca.SX.sym(name, 4) for name in names]
        return ca.Function("inverse_dynamics", motion, [self.symbolic(*motion)], names, ["tau"])

    @cached_property
    def _path_load(self) -> ca.Function:
        """Function of q, dq and ddq that returns the coefficients of `path_load`."""
        return self._split("path_load", along_path=True)

    @cached_property
    def _effort_parts(self) -> ca.Function:
        """Function of q, qd and qdd that returns the parts of the efforts."""
        return self._split("parts", along_path=False)

    def _split(self, name: str, *, along_path: bool) -> ca.Function:
        """Build a function that divides the joint efforts into three parts.

        `path_load` and `effort_parts` call it. The first two parts are the efforts of two motions
        minus the effort of gravity, and the third part is the effort of gravity.

        Parameters
        ----------
        name : str
            Name of the function.
        along_path : bool
            True for the parts of `path_load`, whose arguments are q and its derivatives with
            respect to the path. False for those of `effort_parts`, whose arguments are q and its
            time derivatives.

        Returns
        -------
        casadi.Function
            Function of three vectors (4,) that returns the three parts, (4,) each.
        """
        q = ca.SX.sym("q", 4)
        dq = ca.SX.sym("first", 4)
        ddq = ca.SX.sym("second", 4)
        zero = ca.SX.zeros(4)
        gravity = self.symbolic(q, zero, zero)
        if along_path:
            inertia = self.symbolic(q, zero, dq)
            velocity = self.symbolic(q, dq, ddq)
        else:
            inertia = self.symbolic(q, zero, ddq)
            velocity = self.symbolic(q, dq, zero)
        efforts: Any = [inertia - gravity, velocity - gravity, gravity]
        return ca.Function(name, [q, dq, ddq], ca.cse(efforts))

    @cached_property
    def _mass_matrix(self) -> ca.Function:
        """Function of q that returns the entries of the mass matrix column by column."""
        q = ca.SX.sym("q", 4)
        qdd = ca.SX.sym("qdd", 4)
        tau = self.symbolic(q, ca.SX.zeros(4), qdd)
        return ca.Function("mass_matrix", [q], [ca.vec(ca.densify(ca.jacobian(tau, qdd)))])


_latest_dynamics: tuple[tuple[Any, ...], bytes, RigidBody] | None = None
"""Geometry and bodies, gravity, and dynamics of the robot whose dynamics were last requested."""


@lru_cache(maxsize=16)
def _cached_dynamics(content: bytes) -> RigidBody:
    """Build the dynamics from pickled data, or return the earlier result for equal data.

    Parameters
    ----------
    content : bytes
        Pickled tuple of geometry, bodies and acceleration of gravity.

    Returns
    -------
    RigidBody
        Dynamics of the robot.
    """
    return RigidBody(*pickle.loads(content))


def with_payload(robot: Robot, mass: float) -> Robot:
    """Return the robot with a point mass at the tool tip.

    The tool tip is the origin of the frame of the last body, so its inertia about the origin stays
    the same and only its mass and centre of mass change.

    Parameters
    ----------
    robot : Robot
        Robot without the payload.
    mass : float
        Mass of the payload, kg.

    Returns
    -------
    Robot
        The changed robot, or the same one for a mass of 0.

    Raises
    ------
    ProblemError
        If the mass is negative or not a number.
    """
    if mass == 0.0:
        return robot
    if not mass > 0.0:
        raise ProblemError("not a mass", key="payload", value=mass, allowed="0 kg or more")
    body_1, body_2, third, tool = robot.bodies
    total = tool.mass + mass
    com = read_only_array(tool.com * tool.mass / total, (3,))
    return replace(robot, bodies=(body_1, body_2, third, replace(tool, mass=total, com=com)))
