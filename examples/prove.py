"""Prove that a motion keeps its limits at every instant: python prove.py plan.json

The file needs NumPy alone. It trusts the polynomials and the robot in plan.json, IEEE 754, and that
sqrt, asin and acos of the C library err by less than 1e-15. A Taylor model is f(s) = Σ c_k s^k ± r
for s in [−1, 1], the time in a box, which is a part of one piece. Every operation adds the terms
that it drops and its rounding errors to r. The terms of r are positive, so that the factor UP
covers their own rounding. A bound of the model holds at every instant of the box.
"""
import copy
import json
import math
import sys
from collections import namedtuple

import numpy as np

N, U, UP, TINY = 5, 2.0**-53, 1 + 1e-13, 1e-290  # degree; rounding error; see above; underflow
TOLERANCE, JUMP, SHARE = 1e-6, 1e-6, 1e-3  # relative rounding; largest jump; share of jumps per s
STILL, SLOW = 1e-9, 1e-6  # shares of the largest speed at which a joint rests, and may start
ON, OFF, STEEP = 1e-6, 1e-7, 1e3  # m from the curves: kept, left; weight of conditions
TURN, SPAN, SHORT = 0.06, 0.05, 1e-8  # largest box in rad and s; smallest one at a reversal in s
FIELDS = ("name", "joint", "low", "high", "limit", "time", "excess", "verdict")
Claim = namedtuple("Claim", FIELDS)
State = namedtuple("State", ("sign", "mask", "sure", "moving", "static"))  # of a joint, in boxes

class Model:
    """Taylor models: coefficients c (≤ N + 1, …), errors r (…). The last axis counts boxes."""
    __array_ufunc__ = None
    def __init__(self, c, r):
        self.c, self.r, self.size = c, r, (np.abs(c).sum(0) + r) * UP  # |f| ≤ size
    def __getitem__(self, key):
        return Model(self.c[(slice(None), *np.index_exp[key])], self.r[key])
    def padded(self, count, axes=0):
        """Return c with zeros up to s^(count − 1) and at least so many axes."""
        shape, missing = self.r.shape, count - len(self.c)
        c = np.concatenate([self.c, np.zeros((missing, *shape))]) if missing > 0 else self.c
        return c.reshape(len(c), *[1] * (axes - len(shape)), *shape)
    def __neg__(self):
        return Model(-self.c, self.r)
    def __add__(self, other):
        other = constant(other)
        count, axes = max(len(self.c), len(other.c)), max(self.r.ndim, other.r.ndim)
        c = self.padded(count, axes) + other.padded(count, axes)
        return Model(c, (self.r + other.r + U * np.abs(c).sum(0)) * UP)
    def __sub__(self, other):
        return self + -constant(other)
    def __mul__(self, other):
        """Multiply. Terms above s^N and rounding errors, ≤ (2N+6) U |a||b|, go into r."""
        other, axes = constant(other), max(self.r.ndim, np.ndim(getattr(other, "r", other)))
        a, b = sorted((self.padded(1, axes), other.padded(1, axes)), key=len)
        r = self.size * other.r + other.size * (self.r + (2 * N + 6) * U * self.size) + TINY
        c = np.zeros((len(a) + len(b) - 1, *r.shape))
        for k, a_k in enumerate(a):
            c[k:k + len(b)] += a_k * b
        return Model(c[:N + 1], (r + np.abs(c[N + 1:]).sum(0)) * UP)
def constant(x, error=0.0):
    """Return numbers as models. error: their largest relative error."""
    if isinstance(x, Model):
        return x
    return Model(np.asarray(x, float)[None], np.abs(x) * (error * UP))
def given(x):
    """Return a number, vector or matrix of the plan as a constant for all boxes."""
    return constant(np.asarray(x, float)[..., None])
def choose(mask, a, b):
    """Return a in the boxes of the mask and b in the others."""
    return Model(np.where(mask, a.padded(N + 1), b.padded(N + 1)), np.where(mask, a.r, b.r))
def hull(low, high):
    """Return constants that contain all values between two bounds."""
    return Model((low + high)[None] / 2, (high - low) * UP)
def taylor(z, derivatives, bound=1.0):
    """Return Σ d_k z^k/k! ± bound |z|^n/n!; bound: of the n-th derivative (Lagrange)."""
    y, n = constant(0.0), len(derivatives)
    for k in reversed(range(n)):
        y = y * z + constant(derivatives[k] / math.factorial(k), U)
    return Model(y.c, (y.r + bound * z.size**n / math.factorial(n)) * UP)
def sin_cos(x):
    """Return sin x and cos x by sin 2z = 2 sin z cos z and cos 2z = 1 − 2 sin² z from z = x/128."""
    sine, cosine = (taylor(x * 2.0**-7, d * 3) for d in ([0, 1, 0, -1], [1, 0, -1, 0]))
    for _ in range(7):
        sine, cosine = sine * cosine * 2.0, sine * sine * -2.0 + 1.0
    return sine, cosine
def exponential(x):
    """Return e^x for x ≤ 1 by e^2z = (e^z)² from z = x/128. Below −40 it is in [0, 5e-18]."""
    z = x * 2.0**-7
    y = taylor(z, [1] * 12, np.where(z.size < 1, 3.0, np.inf))
    for _ in range(7):
        y = y * y
    return choose(bounds(x)[1] < -40, hull(0 * x.c[0], 0 * x.c[0] + 5e-18), y)
def power(x, p):
    """Return x^p = m^p Σ binom(p, k) d^k for p = −1 or ±1/2, where d = x/m − 1 and m = c_0.

    Derivative N+1 of (1 + d)^p is at most |p (p−1) … (p−N)| (1 − |d|)^(p−N−1); |d| must be < 1/2.
    """
    m = np.where((x.c[0] > 0) | ((p == -1) & (x.c[0] < 0)), x.c[0], np.nan)
    inverse = constant(1 / m, 2 * U)
    d = Model(np.concatenate([0 * x.c[:1], x.c[1:]]), x.r) * inverse
    falling = [math.prod(p - i for i in range(k)) for k in range(N + 2)]
    rest = abs(falling[-1]) * (1 - np.minimum(d.size, 0.5)) ** (p - N - 1)
    y = taylor(d, falling[:-1], np.where(d.size < 0.5, rest, np.inf))
    return y * (inverse if p == -1 else constant(np.sqrt(m) if p > 0 else 1 / np.sqrt(m), 3 * U))
BASIS = [np.poly([1.0] * (N - j) + [-1.0] * j)[::-1] * (-1.0) ** (N - j) for j in range(N + 1)]
TO_BERNSTEIN = np.array(BASIS) / [math.comb(N, k) for k in range(N + 1)]  # of (1−z)^(N−j) (1+z)^j
def bernstein(f):
    """Return b (N + 1, …) and e: min b − e ≤ f ≤ max b + e, and f = b_0, b_N ± e at the ends."""
    return np.tensordot(TO_BERNSTEIN, f.padded(N + 1), 1), (f.r + (N + 6) * U * f.size + TINY) * UP
def bounds(f):
    """Return a lower and an upper bound of f in every box."""
    b, e = bernstein(f)
    return b.min(0) - e * UP, b.max(0) + e * UP
def halves(b):
    """Return the Bernstein coefficients in the first and in the second halves (de Casteljau)."""
    left, right = [b[0]], [b[-1]]
    while len(b) > 1:
        b = (b[:-1] + b[1:]) / 2
        left, right = [*left, b[0]], [b[-1], *right]
    return np.concatenate([np.stack(left), np.stack(right)], -1)
def supremum(choices, sure, start, stop, scale=None):
    """Return low ≤ sup_t min_k max_j f_kj(t) ≤ high over all boxes, and the time of a large value.

    choices: tuples f_k of functions, or single functions. Only the first function of a tuple
    counts for witnesses, in the boxes `sure`, in which it is a value of the motion. The others
    are conditions of a choice. scale: of the functions; the result is closer than 2e-9 of it.
    """
    choices = [x if isinstance(x, tuple) else (x,) for x in choices]
    first = np.cumsum([0, *map(len, choices)])[:-1]
    pairs = zip(*(bernstein(f) for choice in choices for f in choice), strict=True)
    b, e = (np.stack(x, -2) for x in pairs)
    bad = ~(np.isfinite(b).all(0) & np.isfinite(e))  # nothing is known, and nothing stays NaN
    b, e, low, high, best = np.where(bad, 0, b), np.where(bad, np.inf, e), -np.inf, -np.inf, -np.inf
    close, time = 2e-9 * (scale or np.abs(b).max()), start[b[0, first].min(0).argmax()]
    for depth in range(60):
        top, ends = np.maximum.reduceat(b.max(0) + e, first).min(0), b[[0, -1]] - e
        best = max(best, np.maximum.reduceat(ends, first, axis=1).min(1).max())
        values = np.where(sure, ends[:, first].min(1), -np.inf)
        if values.max() > low:
            low, time = values.max(), np.stack([start, stop]).ravel()[values.argmax()]
        near = (b.min(0) - e <= best) & (best <= b.max(0) + e)
        exact = (~near | (np.ptp(b, 0) <= e)).all(0)  # rounding is larger than what is left
        done = (top <= best + close) | exact | np.isinf(top)
        done |= (depth == 59) | (len(top) > 1e5)
        high = max(high, top[done].max(initial=-np.inf))
        if done.all():
            break
        e = np.tile((e + (N + 1) * U * np.abs(b).max(0))[:, ~done], 2)
        b, sure = halves(b[..., ~done]), np.tile(sure[~done], 2)
        start, stop = split(start, stop, ~done)
    return low, max(low, high), time

def split(begin, end, chosen):
    """Return the begins and ends of the first and of the second halves of chosen intervals."""
    begin, end = begin[chosen], end[chosen]
    return np.append(begin, (begin + end) / 2), np.append((begin + end) / 2, end)

def dot(a, b):
    """Return the inner products of vectors (3, n)."""
    c = a * b
    return c[0] + c[1] + c[2]
def cross(a, b):
    """Return the vector products of vectors (3, n)."""
    return a[[1, 2, 0]] * b[[2, 0, 1]] - a[[2, 0, 1]] * b[[1, 2, 0]]
def apply(matrix, x):
    """Return the products of a matrix (3, 3, 1) with vectors (3, n)."""
    return matrix[:, 0] * x[0] + matrix[:, 1] * x[1] + matrix[:, 2] * x[2]
def unit(x):
    """Return x/|x|."""
    return x * power(dot(x, x), -0.5)
class Boxes:
    """Models of q, q̇, q̈ and the jerk in boxes [begin, end] of pieces, and what follows."""
    def __init__(self, plan, piece, begin, end):
        self.piece, self.begin, self.end, self.robot = piece, begin, end, plan["problem"]["robot"]
        breaks, middle = np.array(plan["trajectory"]["breaks_s"]), (begin + end) / 2
        self.start, self.stop = breaks[piece] + begin, breaks[piece] + end
        self.half = np.nextafter(np.maximum(end - middle, middle - begin), np.inf)
        time = Model(np.stack([middle, self.half]), 0 * middle)
        terms = np.array(plan["trajectory"]["coefficients"], float)[piece].transpose(1, 2, 0)
        terms, self.motion = [constant(c) for c in terms], []
        for _ in range(4):
            self.motion.append(terms[-1])
            for term in terms[-2::-1]:
                self.motion[-1] = self.motion[-1] * time + term
            terms = [term * float(k) for k, term in enumerate(terms)][1:]
    def turned(self, k, x, sense=1.0):
        """Return x turned by joint k: a(a·x) + (x − a(a·x)) cos q + a×x sin q (Rodrigues)."""
        along = self.axes[k] * dot(self.axes[k], x)
        return along + (x - along) * self.cosine[k] + cross(self.axes[k], x) * self.sine[k] * sense
    def efforts(self, payload=0.0):
        """Return τ by Newton and Euler about the remote centre, in frames that turn with bodies.

        payload: mass in the origin of the last body's frame, the tip. τ is affine in this mass.
        f = m (−g + s̈ + ω̇×p + ω×(ω×p)) and M = I ω̇ + ω×(I ω) + p×f, I about the centre of mass.
        """
        (q, v, a, _), (self.sine, self.cosine) = self.motion, sin_cos(self.motion[0])
        first, second, third = (unit(given(self.robot["geometry"][f"omega{i}"])) for i in (1, 2, 3))
        self.axes = [first, second, third]
        self.across = unit(second - first * dot(first, second))  # t
        self.normal = cross(first, self.across)  # n
        to_n, to_t = (float(dot(third, x).c[0, 0]) for x in (self.normal, self.across))
        sense = -to_n if abs(to_n) > 1e-9 else to_t if to_t > 1e-9 else -1.0
        self.side = math.copysign(1.0, sense)  # sign of φ
        self.tool = self.turned(0, self.turned(1, third))  # u
        self.omega = self.axes[0] * v[0] + self.turned(0, self.axes[1]) * v[1]  # u̇ = Ω×u
        w, dw, base, moments = given([0] * 3), given([0] * 3), -given(self.robot["gravity"]), []
        thrust = given([0] * 3)
        bodies, zero = self.robot["bodies"], [0.0] * 3
        tip = {**bodies[3], "mass": payload, "com": zero, "inertia": [zero] * 3}
        for k, body in enumerate([*bodies, tip] if payload else bodies):
            frame, back = given(body["frame"]), given(np.transpose(body["frame"]))
            com, inertia, axis = given(body["com"]), given(body["inertia"]), self.axes[min(k, 2)]
            place, slide = apply(frame, com), given([0] * 3)
            if k < 3:
                w, dw, base = (self.turned(k, x, -1.0) for x in (w, dw, base))
                dw, w = dw + axis * a[k] + cross(w, axis) * v[k], w + axis * v[k]
            else:
                place, slide = place + axis * q[3], axis * a[3] + cross(w, axis) * v[3] * 2.0
            spin, gain = (apply(frame, apply(inertia, x) - (x * dot(com, com) - com * dot(com, x))
                                * body["mass"]) for x in (apply(back, w), apply(back, dw)))
            force = (base + slide + cross(dw, place) + cross(w, cross(w, place))) * body["mass"]
            moments.append(gain + cross(w, spin) + cross(place, force))
            thrust = thrust + force if k > 2 else thrust
        total = sum(moments[3:], moments[2])
        second = moments[1] + self.turned(2, total)
        first = moments[0] + self.turned(1, second)
        loads = (first, second, total, thrust)
        return [dot(x, y) for x, y in zip([*self.axes, axis], loads, strict=True)]
    def seen(self, u):
        """Return |sin φ| cos ψ, |sin φ| sin ψ and cos φ of tools u."""
        return dot(u, self.normal) * -self.side, dot(u, self.across) * self.side, \
            dot(u, self.axes[0])
    def pointing(self, roll, tilt):
        """Return u = ω₁ cos φ + (t sin ψ − n cos ψ) sin φ."""
        (s, c), (sine, cosine) = sin_cos(given(roll)), sin_cos(given(tilt))
        return self.axes[0] * cosine + (self.across * s - self.normal * c) * sine
    def coordinates(self, u, depth):
        """Return roll, tilt and depth where boxes begin, and the largest errors of each.

        An error ε of a vector with the length ρ turns it by at most 2 ε/ρ if ε < ρ/2.
        """
        ends = [bernstein(x) for x in (*self.seen(u), depth)]
        (c, s, axial, depth), (*errors, last) = ([x[0] for x, _ in ends], [e for _, e in ends])
        across, error = np.hypot(c, s), sum(errors) + 4 * U
        near = np.where(error < across / 2, 2 * error, np.inf)
        now = {"roll": np.arctan2(s, c), "tilt": self.side * np.arctan2(across, axial)}
        return {**now, "depth": depth}, {"roll": near / across, "tilt": near, "depth": last}
    def posed(self, joints):
        """Return the tool (3, 1) of joint positions."""
        pose = copy.copy(self)
        pose.sine, pose.cosine = sin_cos(given(joints))
        return pose.turned(0, pose.turned(1, self.axes[2]))
    def joint_rates(self, rates):
        """Return q̇ for rates of roll ψ, tilt φ, spin σ and depth, which are 0 if not given.

        Let ω = ω₁ ψ̇ + m φ̇ + u σ̇ = ω₁ q̇₁ + ω₂ q̇₂ + u q̇₃ with the unit vector m along ω₁×u sgn φ.
        The inner products of ω with ω₂×u, ω₁×u and ω₁×ω₂ each contain one of the rates q̇.
        """
        self.efforts()
        first, second, u = self.axes[0], self.turned(0, self.axes[1]), self.tool
        turns = {"roll": first, "tilt": unit(cross(first, u)) * self.side, "spin": u}
        omega = first * 0.0
        for name, axis in turns.items():
            omega = omega + axis * rates.get(name, 0.0)
        speeds = []
        for axis, a, b in ((first, second, u), (second, first, u), (u, first, second)):
            speeds.append(dot(cross(a, b), omega) * power(dot(cross(a, b), axis), -1))
        slide = rates.get("depth", 0.0) * self.robot["geometry"]["insertion_sign"]
        return [*speeds, constant(slide)]
def cut(plan):
    """Return boxes in which joints turn little, keep their direction, and μ is nearly a polynomial.

    A joint is idle in a piece if its speed stays below STILL. In a slow box, it has the directions
    of the piece. Around starts and reversals, boxes are halved down to SHORT; there, both count.
    """
    joints, length = plan["problem"]["robot"]["joints"], np.diff(plan["trajectory"]["breaks_s"])
    piece, begin, end, done = np.arange(len(length)), 0 * length, np.nextafter(length, np.inf), []
    top = np.array([[joint["velocity"]] for joint in joints])
    still, (low, high) = STILL * top, bounds(Boxes(plan, piece, begin, end).motion[1])
    senses = high > still, low < -still
    idle = ~(senses[0] | senses[1])
    while len(piece):
        v, width = Boxes(plan, piece, begin, end).motion[1], end - begin
        (low, high), (b, e) = bounds(v), bernstein(v)
        slow = np.abs(b[[0, -1]]) - e <= SLOW * top
        cuts = (low < -still) & (high > still) | slow[0] & ~slow[1]
        cuts = (cuts & ~idle[:, piece]).any(0)
        for j, drive in enumerate(joint["drive"] for joint in joints):
            if drive and drive["friction"]:
                mu = friction(drive, v[j] * np.where(high[j] > -low[j], 1.0, -1.0))
                cuts |= ~(mu.r <= 1e-9 * drive["friction"]["mu"])
        cuts = cuts & (width > SHORT) | (v.size[:3].max(0) * width > TURN) | (width > SPAN)
        rest = np.abs(b[0]) + e <= still
        done.append([x[~cuts] for x in (piece, begin, end, *slow[0], *rest, *low, *high)])
        piece, (begin, end) = np.tile(piece[cuts], 2), split(begin, end, cuts)
    piece, begin, end, *rest = (np.concatenate(x) for x in zip(*done, strict=True))
    starts, resting, low, high = np.reshape(rest, (4, 4, -1))
    boxes = Boxes(plan, piece, begin, end)
    boxes.idle, slow = idle[:, piece], (low >= -still) & (high <= still)
    boxes.up, boxes.down = ((x | slow & sense[:, piece]) & ~boxes.idle for x, sense in
                            zip((high > still, low < -still), senses, strict=True))
    boxes.sure = ~(boxes.up & boxes.down)
    boxes.starts, boxes.rests = (starts > 0) | ~boxes.sure, (resting > 0) & (end - begin <= SHORT)
    return boxes

def friction(drive, speed, static=False):
    """Return μ_k + μ_s e^(−2x) or μ_k + μ_s e^(−x²), x = |w|/w_s. static: at least μ_static."""
    law, mu = drive["friction"], constant(drive["friction"]["mu"] + 0 * speed.c[0])
    if law["law"] != "coulomb" and law["stribeck_speed"] is not None:
        x = speed * drive["ratio"] * power(given(law["stribeck_speed"]), -1)
        x = Model(x.c, x.r + 2 * np.maximum(-bounds(x)[0], 0))  # contains |x|
        mu += exponential(x * -2.0 if "exp" in law["law"] else -(x * x)) * law["mu_stribeck"]
    return hull(*(np.maximum(x, law["mu_static"]) for x in bounds(mu))) if static else mu
def cases(drive, ranged):
    """Return drives with the least and with the most friction of its ranges.

    In the direction σ of the motion, the torque σ τ_m = max_± (γ tan(λ ± φ) σF + …) never falls if
    μ, b_c or b_v grows, as long as 0 < λ + φ < 90°: for either sign of F, the larger row grows with
    φ. It is convex in F. σF grows with b_oc and with b_ov, and is affine in the payload. The torque
    is therefore largest with the most friction, with the least or the largest σF, at an end of the
    payload. It is smallest with the least friction, at such a corner or at F = 0, where both rows
    are equal. The torque of a preloaded screw is linear in F, and grows with μ if its nuts touch.
    """
    law, ranges = drive["friction"], drive["friction_ranges"] if ranged else {}
    ends = []
    for pick, share in ((min, 1 - 1e-15), (max, 1 + 1e-15)):
        new = {name: pick(law[name], *span) for name, span in ranges.items()}
        total = law["mu"] + law["mu_stribeck"]
        if "mu" in new and "mu_static" not in new and total > 0:  # keeps its ratio to μ
            new["mu_static"] = law["mu_static"] / total * (new["mu"] + law["mu_stribeck"]) * share
        ends.append({**law, **new})
    if ends[0] == ends[1]:
        return [[drive]] * 2
    return [[{**drive, "friction": {**end, "b_oc": side["b_oc"], "b_ov": side["b_ov"]}}
             for side in ends] for end in ends]
def locking(drive):
    """Return tan λ and cos θ. A drive locks if tan φ = μ/cos θ > tan λ."""
    sine, cosine = sin_cos(given(drive["lead_angle"]))
    return sine * power(cosine, -1), sin_cos(given(drive["pressure_angle"]))[1]
def rows(drive, motion, sign, mu):
    """Return F and rows; the motor's torque times its direction `sign` is the largest row.

    F = τ + J_out q̈ + b_oc sgn + b_ov q̇. Row: γ tan(λ ± φ) F + J_in k q̈ + b_c sgn + b_v k q̇, with
    tan(λ ± φ) = (tan λ ± tan φ)/(1 ∓ tan λ tan φ) and tan φ = μ/cos θ. The nuts of a preloaded
    screw carry F − P and P + m₂ q̈, and the direction alone selects both signs: one row. A gear
    stage with ratio N divides a row by N η if it opposes the motion, and multiplies it by η_b/N if
    it drives the motor.
    """
    (load, v, a), law, k, (lead, normal) = motion, drive["friction"], drive["ratio"], locking(drive)
    wedge, preload = mu * power(normal, -1), drive["preload"]
    up, down = ((lead + x) * power(lead * -x + 1.0, -1) * drive["gamma"] for x in (wedge, -wedge))
    for stage in filter(None, (drive.get("gearhead"), drive.get("belt"))):
        per_turn = power(given(stage["ratio"]), -1)
        driving = per_turn * power(given(stage["efficiency"]), -1)
        driven = per_turn * given(stage["backward_efficiency"] or stage["efficiency"])
        up *= driving
        down = hull(*(np.minimum(*x) for x in zip(bounds(down * driving), bounds(down * driven),
                                                  strict=True)))
    effort = load + a * drive["output_inertia"] + v * law["b_ov"] + sign * law["b_oc"]
    base = a * k * drive["input_inertia"] + v * k * law["b_v"] + sign * law["b_c"]
    if drive["kind"] != "antibacklash_screw":
        return effort, [(slope * effort + base) * sign for slope in (up, down)]
    main, other = (down, up) if sign > 0 else (up, down)
    nuts = main * (effort - preload) + other * (a * drive["second_nut_mass"] + preload)
    return effort, [(nuts + base) * sign]
def heat(effort, torques):
    """Enclose ∫ max(r_1, r_2)² ds over s in [−1, 1] in every box.

    The first row is the largest where effort ≥ 0. Boxes are halved until its sign is known. Where
    it stays unknown, the integral of the larger square is at most its largest value times width.
    """
    squares = [effort, torques[0] * torques[0], torques[-1] * torques[-1]]
    b, e = (np.stack(x, -2) for x in zip(*map(bernstein, squares), strict=True))
    box, width, low, high = np.arange(b.shape[2]), 2.0, 0 * e[0], 0 * e[0]
    for _ in range(30):
        first = (b[:, 0].min(0) >= e[0]) | (len(torques) == 1)
        last = (b[:, 0].max(0) <= -e[0]) & ~first
        for row, known in ((1, first), (2, last)):
            mean, error = b[:, row, known].mean(0) * width, e[row, known] * width * UP
            np.add.at(low, box[known], mean - error)
            np.add.at(high, box[known], mean + error)
        left = ~(first | last)
        b, e, box = b[..., left], e[:, left] + (N + 1) * U * np.abs(b[..., left]).max(0), box[left]
        if not 0 < len(box) < 5000:
            break
        b, e, box, width = halves(b), np.tile(e, 2), np.tile(box, 2), width / 2
    np.add.at(high, box, width * (b[:, 1:].max((0, 1)) + e[1:].max(0)))
    return np.maximum(low, 0) * (1 - 1e-12), high * (1 + 1e-12)

class Proof:
    """Collects enclosures of the excess of each limit, (value − limit)/half width."""
    def __init__(self, plan):
        self.plan, self.problem, self.parts, self.boxes = plan, plan["problem"], {}, cut(plan)
        masses = sorted({0.0, max(self.problem["payload"] or (0.0,))}, reverse=True)
        self.robot, self.loads = self.problem["robot"], [self.boxes.efforts(m) for m in masses]
        self.tau = self.loads[-1]
    def add(self, key, ends, limit, **more):
        """Note bounds (low, high) of the largest side·value, which must not exceed the limit.

        more: half width that the excess refers to (default: the limit), time, and side, 1 or −1.
        """
        half = more.get("half", limit)
        excess = [(x - limit) / half for x in ends]
        part = excess, limit, half, more.get("time", 0.0), more.get("side", 1.0)
        self.parts.setdefault(key, []).append(part)
    def largest(self, functions, mask=True, sure=True, value=float, scale=None):
        """Return bounds of the smallest function in some boxes, and a time. value: to the unit.

        Every function has all boxes, or those of the mask. `supremum` explains the others.
        """
        at = np.broadcast_to(mask, self.boxes.half.shape)
        sure, boxes = np.broadcast_to(sure, at.shape)[at], self.boxes
        *ends, time = supremum(functions, sure, boxes.start[at], boxes.stop[at], scale)
        ends = [value(x) if math.isfinite(x) else x for x in ends]
        error = 0.0 if value is float else 1e-15
        low, high = (error * (1 + min(abs(x), 1e9)) for x in ends)
        return (ends[0] - low, ends[1] + high), time
    def below(self, key, functions, limit, **how):
        """Bound side·value, an increasing function `value` of the smallest of the functions."""
        at = np.broadcast_to(how.get("mask", True), self.boxes.half.shape)
        if at.any():
            self.bound(key, [f[..., at] for f in functions], limit, **how)
    def bound(self, key, choices, limit, **how):
        """Do the same in boxes `mask`, of which the functions consist."""
        more = {name: how.pop(name) for name in ("half", "side") if name in how}
        ends, time = self.largest(choices, **how)
        self.add(key, ends, limit, time=time, **more)
    def between(self, key, ends, bands):
        """Bound a value from both sides. bands: see `both`."""
        half = (ends[1] - ends[0]) / 2 if 0 < ends[1] - ends[0] < math.inf else 1.0
        for functions, limit, side, value in bands:
            self.below(key, functions, limit, half=half, side=side, value=value)
    def joint(self, j, joint):
        """Bound position, speed, acceleration, jerk, and speed of the motor; self-locking."""
        name, drive, motor = joint["name"], joint["drive"], joint["motor"]
        q, v, a, jerk = self.boxes.motion
        self.between(("position", name), joint["position"], both(q[j], *joint["position"]))
        limits = {"velocity": v[j], "acceleration": a[j], "jerk": jerk[j]}
        limits = [(kind, joint[kind], x) for kind, x in limits.items()]
        if drive and motor:
            limits.append(("motor speed", motor["max_speed"], v[j] * drive["ratio"]))
            self.torque(j, name, drive, motor)
        for kind, top, x in limits:
            if top is not None:
                self.between((kind, name), (-top, top), both(x, -top, top))
        if drive and drive["self_locking"]:
            law, (lead, normal) = drive["friction"], locking(drive)
            mu = law["mu"] if law["mu_lowest"] is None else law["mu_lowest"]
            if self.problem["friction"]:
                mu = min(mu, *drive["friction_ranges"].get("mu", (mu,)))
            for needed in np.ravel(bounds(lead * normal)):
                self.add(("self-locking", name), (-mu, -mu), -needed, half=needed, side=-1.0)
    def torque(self, j, name, drive, motor):
        """Bound |τ|, the forces of the nuts, and the root mean square of τ, in all `cases`.

        With σ τ = g − b, where g ≥ 0 drives and b ≥ 0 brakes, ∫g² is convex with the most friction
        like g, so that it is largest at a corner. For b, the largest value in each box counts.
        """
        boxes, top, ends = self.boxes, motor["max_torque"], cases(drive, self.problem["friction"])
        key, law, (_, v, a, _) = ("motor torque", name), drive["friction"], (x[j] for x in boxes.motion)
        least, most = ([(case, load[j]) for case in end for load in self.loads] for end in ends)
        heats, brakes = [([], []) for _ in most], 0 * boxes.half
        if ends[0] is ends[1]:
            most = least
        elif not self.monotone(drive, most + least, v, a):
            self.add(key, (-math.inf, math.inf), top)
        for sign, mask in ((0.0, boxes.idle[j]), (1.0, boxes.up[j]), (-1.0, boxes.down[j])):
            held = self.tau[j] + a * drive["output_inertia"] + v * law["b_ov"] + sign * law["b_oc"]
            self.nuts(name, drive, (held, a), mask=mask, sure=boxes.sure[j] | boxes.idle[j])
        for state in self.states(j):
            low = [self.rows(j, state, *case) for case in least]
            high = low if most is least else [self.rows(j, state, *case) for case in most]
            for _, torques, unloaded in low:
                how = {"side": -state.sign, "mask": state.mask}
                self.below(key, [-row for row in torques], top, sure=state.sure, **how)
                if len(most) > 1:
                    sets = [torques, unloaded() if len(torques) > 1 else torques]  # see `cases`
                    self.below(key, [-row for row in sets[1]], top, sure=False, **how)
                    brakes = np.maximum(brakes, np.where(state.mask, self.braking(*sets), 0))
            for (effort, torques, _), sums in zip(high, heats, strict=True):
                for row in torques if state.moving else []:
                    self.below(key, [row], top, side=state.sign, mask=state.mask, sure=state.sure)
                if not (state.moving and state.static):
                    self.warm(state, effort, torques, sums)
        if self.problem["duty"] is not None:
            time, top = boxes.stop.max(), motor["nominal_torque"]
            span = time - boxes.start.min() + self.problem["duty"]
            low, high = (max(math.fsum(x[k]) for x in heats) for k in (0, 1))
            high += math.fsum(brakes**2 * boxes.half) * 2
            ends = math.sqrt(low / span) * (1 - 1e-11), math.sqrt(high / span) * (1 + 1e-11)
            self.add(("continuous torque", name), ends, top, time=time)
    def states(self, j):
        """Yield the ways in which a joint moves or rests, with the boxes in which it may do so."""
        boxes = self.boxes
        idle, sure, starts = boxes.idle[j], boxes.sure[j], boxes.starts[j]
        for sign, moves in ((1.0, boxes.up[j]), (-1.0, boxes.down[j])):
            for state in (State(sign, moves, sure, True, False), State(sign, idle, idle, False, True),
                          State(sign, moves & starts, sure & boxes.rests[j], True, True)):
                if state.mask.any():
                    yield state
    def rows(self, j, state, drive, load):
        """Return F, the rows of the torque, and a function that returns those at F = 0."""
        _, v, a, _ = (x[j] for x in self.boxes.motion)
        held = load + a * drive["output_inertia"] + v * drive["friction"]["b_ov"]
        load, *rates = (load, v, a) if state.moving else (held, v * 0.0, a * 0.0)
        mu = friction(drive, rates[0] * state.sign, state.static)
        effort, torques = rows(drive, (load, *rates), state.sign, mu)
        return effort, torques, lambda: rows(drive, (load - effort, *rates), state.sign, mu)[1]
    def braking(self, *sets):
        """Return upper bounds of −max(rows) and 0 in all boxes, of several sets of rows."""
        slowest = [np.max([bounds(row)[0] for row in torques], 0) for torques in sets]
        return np.nan_to_num(np.maximum(-np.min(slowest, 0), 0), nan=np.inf, posinf=np.inf)
    def warm(self, state, effort, torques, sums):
        """Add bounds of ∫τ² in each box to the lists `sums`.

        An idle joint has the torque nearest to 0 between the breakaway torques, −max(rows) in
        both directions. `gap` is the part of [−1, 1] beyond a box, in s.
        """
        boxes, mask = self.boxes, state.mask
        gap = 2 * boxes.half - (boxes.end - boxes.begin) * (1 - 4 * U)
        low, high = heat((effort * state.sign)[mask], [row[mask] for row in torques])
        ends = zip(*map(bounds, torques), strict=True)
        least, most = (np.max(x, 0)[mask] for x in ends)
        if not state.moving:
            low, high = np.where(most <= 0, low, 0), np.where(least >= 0, 0, high)
        low = low * boxes.half[mask] - gap[mask] * np.maximum(-least, most) ** 2
        sums[0].extend(np.maximum(low, 0) * state.sure[mask])
        sums[1].extend(high * boxes.half[mask])
    def monotone(self, drive, both, v, a):
        """Return whether λ + φ < 90° and nuts touch in all cases, so that the torque grows with μ."""
        lead = math.tan(drive["lead_angle"]) / math.cos(drive["pressure_angle"])
        forces = [-a * drive["second_nut_mass"]]
        for case, load in both:
            law, held = case["friction"], load + a * case["output_inertia"]
            if not lead * max(law["mu"] + law["mu_stribeck"], law["mu_static"]) < 0.999:
                return False
            forces += [held + v * law["b_ov"] + sign * law["b_oc"] for sign in (1.0, -1.0)]
        touching = all((bounds(x)[1] < drive["preload"]).all() for x in forces)
        return touching or drive["kind"] != "antibacklash_screw"
    def nuts(self, name, drive, motion, **how):
        """Bound the forces P − F and P + m₂ q̈ on the nuts of a preloaded screw."""
        if drive["kind"] == "antibacklash_screw":
            for force in (motion[0], -motion[1] * drive["second_nut_mass"]):
                force = force - drive["preload"]
                self.below(("nut contact", name), [force], 0.0, half=1.0, side=-1.0, **how)
    def task(self):
        """Bound roll ψ, tilt φ, spin σ, depth, their rates, and the speed of the tip.

        u·ω₁ = cos φ and (−u·n, u·t) = sin φ (cos ψ, sin ψ), where t ⊥ ω₁ is in the plane of ω₁ and
        ω₂, and n = ω₁×t. The tool's x and y see ω₁ at the angle −σ + constant. From
        Ω + u q̇₃ = ω₁ ψ̇ + (⊥ u) φ̇ + u σ̇ follows σ̇ = Ω·u + q̇₃ − ψ̇ cos φ.
        """
        boxes, geometry, (q, v, _, _) = self.boxes, self.robot["geometry"], self.boxes.motion
        (first, _, third), u, side = boxes.axes, boxes.tool, boxes.side
        t, n, rate, (c, s, axial) = boxes.across, boxes.normal, cross(boxes.omega, u), boxes.seen(u)
        inverse = power(c * c + s * s, -0.5)  # 1/|sin φ|
        roll = (c * dot(rate, t) + s * dot(rate, n)) * inverse * inverse * side
        rates = {"roll": roll, "tilt": dot(rate, first) * inverse, "depth": v[3],
                 "spin": dot(boxes.omega, u) + v[2] - roll * axial}
        for name, top in self.problem["rates"].items():
            key = ("insertion speed" if name == "depth" else f"{name} rate", None)
            self.between(key, (-top, top), both(rates[name], -top, top))
        x = given(np.array(geometry["tool_home"])[:, 0])
        x = unit(x - third * dot(third, x))
        now, y = boxes.turned(0, boxes.turned(1, boxes.turned(2, x))), cross(third, x)
        x, y, now_x, now_y = (dot(first, z) for z in (x, y, now, cross(u, now)))
        scale = power(x * x + y * y, -0.5) * inverse
        depth = q[3] * float(geometry["insertion_sign"])
        spin = (now_x * x + now_y * y) * scale, (now_x * y - now_y * x) * scale
        ranges = {"roll": lambda *ends: angle(c * inverse, s * inverse, *ends),
                  "spin": lambda *ends: angle(*spin, *ends),
                  "depth": lambda *ends: both(depth, *ends),
                  "tilt": lambda *ends: tilt(axial, side, *ends)}
        for name, ends in self.problem["limits"].items():
            self.between((f"{name} range", None), ends, ranges[name](*ends))
        if self.problem["tip_speed"]:
            speed = rate * q[3] + u * v[3]
            self.below(("tip speed", None), [dot(speed, speed)], self.problem["tip_speed"],
                       value=root)
        if self.problem["eye"]:
            self.eye(self.problem["eye"], u * q[3], q[3])
        rates["depth"] = v[3] * float(geometry["insertion_sign"])
        return rates, rate * q[3] + u * v[3]
    def promises(self, rates, velocity):
        """Bound what motions promise of their paths: the departure, speed and height of the tip."""
        for chain, first, last in phases(self.plan):
            kinds = {motion.get("curve", motion["kind"]) for motion in chain}
            if kinds & {"straight", "line", "arc", "retina"}:
                at = (first <= self.boxes.piece) & (self.boxes.piece < last)
                self.path(chain, at, rates, dot(velocity, velocity)[at])
    def path(self, chain, at, rates, square):
        """Bound the promises of motions without a stop in the boxes `at`, square: of the speed.

        Let the tip be on a curve if it is at most `near` away. It is on one of the curves or in the
        ball about a corner (path departure, near = ON). If it is on no curve, it is in a ball
        (corner rounding, near = OFF).
        """
        blends, path = [motion["blend"] for motion in chain[:-1]], None
        height, speed = chain[0].get("distance"), chain[0].get("constant_speed")
        promised = {"path departure": ON, "corner rounding": min(blends, default=None),
                    "retina distance": height, "constant speed": speed}
        if not at.any():  # no phase
            for name, limit in promised.items():
                if limit:
                    self.add((name, None), (-math.inf, math.inf), limit)
            return
        path = Path(self, chain, at, rates)
        how = {"mask": at, "sure": path.exact, "scale": 1.0}
        away = [path.tip - corner for corner in path.ends]
        balls = [(dot(x, x), radius) for x, radius in zip(away, blends, strict=False)]
        choices = [ball(x, d + 1e-9, STEEP) for x, d in balls]
        self.bound(("path departure", None), [*path.on(ON), *choices], ON,
                   value=lambda x: ON * root(1 + 2 * x), **how)
        b, e = bernstein(dot(away[-1], away[-1])[[self.boxes.stop[at].argmax()]])
        self.add(("path departure", None), (root(b[-1, 0] - e[0]), root(b[-1, 0] + e[0])), ON,
                 time=self.boxes.stop[at].max())
        if blends:
            near, choices = min(blends), [ball(x, d, 0.5) for x, d in balls]
            choices += [tuple(x * STEEP for x in choice) for choice in path.on(OFF)]
            self.bound(("corner rounding", None), choices, near,
                       value=lambda x: near * root(1 + 2 * x), **how)
        if height:
            top = self.problem["eye"]["radius"]
            far, r = path.tip - given(self.problem["eye"]["centre"]), top - height
            f = (dot(far, far) - r * r) * (0.5 / r)
            for side, value in ((1.0, lambda x: top - root(r * (r - 2 * x))),
                                (-1.0, lambda x: root(r * (r + 2 * x)) - top)):
                self.bound(("retina distance", None), [f * -side], side * height + ON, half=ON,
                           side=side, value=value, mask=at)
        if speed:
            self.steady(square * (0.5 / speed**2) - 0.5, speed, at)
    def steady(self, x, top, at):
        """Bound the speed V √(1 + 2x) of a tip that keeps the speed V except for ramps.

        It never exceeds V, and has the value V from the first to the last instant with this value.
        """
        share, (b, e), boxes = 1e-6, bernstein(x), self.boxes
        start, stop = boxes.start[at], boxes.stop[at]
        key, how = ("constant speed", None), {"half": share * top, "mask": at, "scale": share}
        self.bound(key, [x], top * (1 + share), value=lambda x: top * root(1 + 2 * x), **how)
        order = np.argsort(start)
        first = arrival(b[:, order], e[order], start[order], stop[order], -share)
        order = order[::-1]
        last = -arrival(b[::-1, order], e[order], -stop[order], -start[order], -share)
        if first < last:
            time = Model(np.stack([(start + stop) / 2, (stop - start) / 2]), 8 * U * np.abs(stop))
            after, before = (time - first) * STEEP**2, (constant(last) - time) * STEEP**2
            self.bound(key, [-x, after, before], -top * (1 - share), side=-1.0,
                       value=lambda x: -top * root(1 - 2 * x), **how)
    def eye(self, eye, tip, depth):
        """Bound the distance from the retina and the scale at which the lens touches the shaft.

        Retina: max(R − |p − c|, port + clearance − |p|). The functions have the units of
        (|p − c|² − L²)/2L, L = R − clearance. Lens: ρ² is the minimum over [0, 1] of
        |b + s p|² = C − 2 B s + A s² with scaled vectors; C − B²/A and C − 2 max(B, 0) are below.
        """
        top, (low, high) = eye["radius"] - eye["clearance"], bounds(depth)
        far, gap = np.maximum(high, -low), tip - given(eye["centre"])
        length = choose(low >= 0, depth, choose(high <= 0, -depth, hull(0 * far, far)))
        length = length + (top - eye["port"])
        squares, least = (dot(gap, gap), length * length), constant(top) * top
        functions = [(x - least) * (0.5 / top) for x in squares]
        self.below(("retina clearance", None), functions, -eye["clearance"], half=top, side=-1.0,
                   value=lambda x: root(top * (top + 2 * x)) - eye["radius"])
        if eye["lens"]:
            lens, back = eye["lens"], given(np.transpose(eye["lens"]["frame"]))
            thin = 1 + eye["shaft_radius"] / min(lens["semi_axes"])
            scale = power(given(lens["semi_axes"]), -1)
            p, b = (apply(back, x) * scale for x in (tip, -given(lens["centre"])))
            a, b, c = dot(p, p), -dot(b, p), dot(b, b) + depth * 0.0
            (low, high), (under, over) = bounds(b), bounds(b - a)
            line = choose(high <= 0, c, c - b * b * power(a, -1))
            exact = choose(under >= 0, a - b * 2.0 + c, line)
            positive = choose(low >= 0, b, hull(0 * high, np.maximum(high, 0)))
            sure = (under >= 0) | (high <= 0) | (low >= 0) & (over <= 0)
            self.below(("lens clearance", None), [-exact, positive * 2.0 - c], -thin, half=thin,
                       side=-1.0, value=lambda x: -root(-x), sure=sure)
    def breaks(self):
        """Bound jumps at the breaks, also of sums of jumps less a share of time, and end speeds."""
        length = np.diff(self.plan["trajectory"]["breaks_s"])
        pieces = np.arange(len(length))
        ends = Boxes(self.plan, pieces, length * (1 - 2 * U), np.nextafter(length, np.inf))
        starts = Boxes(self.plan, pieces, 0 * length, 0 * length)
        for j, joint in enumerate(self.robot["joints"]):
            levels = [1.0, joint["velocity"], joint["acceleration"], joint["jerk"] or math.inf]
            kinds = ("position", "velocity", "acceleration")
            for order, kind in enumerate(kinds[:3 if joint["jerk"] else 2]):
                step = starts.motion[order][j][1:] - ends.motion[order][j][:-1]
                low, high = bounds(step)
                high = np.nan_to_num(np.maximum(high, -low), nan=np.inf)
                level, worst = 0.0, (0.0, 0.0)
                for jump, time, span in zip(high, starts.start[1:], length, strict=False):
                    level = (jump + max(level - SHARE * levels[order + 1] * span, 0)) * UP
                    worst = max(worst, (level, time))
                least = np.maximum(np.maximum(low, -bounds(step)[1]), 0).max(initial=0)
                key, top = (f"{kind} jump", joint["name"]), JUMP * levels[order]
                self.add(key, (least, worst[0]), top, time=worst[1])
            for kind, boxes, k in (("start", starts, 0), ("end", ends, -1)):
                declared = self.problem[f"{kind}_rate"]
                low, high = 0.0, 0.0
                if declared is not None:  # None: any speed
                    speed = boxes.joint_rates(declared)[j] if declared else constant(0.0)
                    low, high = (float(x[k]) for x in bounds(boxes.motion[1][j] - speed))
                span, top = (max(low, -high, 0.0), max(high, -low)), JUMP * joint["velocity"]
                self.add((f"{kind} velocity", joint["name"]), span, top, time=boxes.start[k])

def phases(plan):
    """Yield motions that join without a stop, and their pieces [first, last), (0, 0) if unknown.

    Phases must follow one another. A scan and a curve through samples have any number of them.
    """
    spans, breaks = plan["trajectory"].get("phases", []), plan["trajectory"]["breaks_s"]
    starts, ends = ([span[key] for span in spans] for key in ("start_s", "end_s"))
    follow = [*starts, breaks[-1]] == [breaks[0], *ends] and {*starts, *ends} <= {*breaks}
    names, index, counted, chain = [span["name"] for span in spans], 0, True, []
    for motion in plan["problem"]["motion"]:
        chain.append(motion)
        if motion.get("blend"):
            continue
        name = " + ".join(dict.fromkeys(part["name"] for part in chain))
        if motion["kind"] == "scan" or motion.get("curve") == "samples":
            counted = False
        else:
            if not counted and name in names[index:]:
                index = names.index(name, index)
            elif counted and names[index:index + 1] == [f"{name}, approach"]:
                index += 1
            known = follow and names[index:index + 1] == [name]
            ends = [breaks.index(spans[index][key]) for key in ("start_s", "end_s")] if known else 0
            yield chain, *(ends or (0, 0))
            counted, index = True, index + 1
        chain = []
    if chain:
        yield chain, 0, 0

class Path:
    """The curves of one phase, and the tip in its boxes."""
    def __init__(self, proof, chain, at, rates):
        """Each curve starts where the one before it ends, the first one where the phase starts."""
        self.boxes, self.sign = proof.boxes, float(proof.robot["geometry"]["insertion_sign"])
        u, self.depth = self.boxes.tool[:, at], self.boxes.motion[0][3][at] * self.sign
        tip, begin = u * self.depth * self.sign, self.boxes.start[at].argmin()
        (b, e), (now, self.errors) = bernstein(tip[:, [begin]]), self.boxes.coordinates(u, self.depth)
        order, turns = np.argsort(self.boxes.start[at]), 2 * math.pi
        now["roll"][order] = np.unwrap(now["roll"][order])
        rolls = [m["target"]["task"]["roll"] for m in chain
                 if m["kind"] == "straight" and "roll" in m["target"]["task"]]
        if rolls:
            now["roll"] += turns * np.round((rolls[-1] - now["roll"][order[-1]]) / turns)
        self.task = {name: integral(rates[name][at], self.boxes.half[at])
                     + Model(x[None], self.errors[name] + 4 * U * np.abs(x)) for name, x in now.items()}
        self.errors = {name: x[begin] for name, x in self.errors.items()}  # of places
        place, start, self.ends = {name: x[begin] for name, x in now.items()}, Model(b[:1], e), []
        self.tip, self.curves, (low, high) = tip, [], bounds(self.depth)
        self.far = max(high.max(), -low.min())
        self.exact = all(motion["kind"] == "path" for motion in chain)
        for motion in chain:
            tips, before = [start], place
            for point in (*motion["through"], motion["target"]):
                place, end = self.place(point, place)
                tips.append(end)
            if motion["kind"] == "straight":
                self.curves.append(self.straight(before, place))
            elif motion["curve"] == "line":
                self.curves.append(self.segment(*tips))
            elif motion["curve"] == "arc":
                self.curves += self.arc(*circle(*tips))
            else:
                eye, u = proof.problem["eye"], self.boxes.pointing(place["roll"], place["tilt"])
                c, u = given(eye["centre"]), u * self.sign
                along, r = dot(u, c), eye["radius"] - motion["distance"]
                depth = along + power(along * along - dot(c, c) + r * r, 0.5)
                place, tips[-1] = {**place, "depth": float(depth.c[0, 0])}, u * depth
                self.errors["depth"] += float(depth.r[0])
                start, end = start - c, tips[-1] - c
                self.curves += self.arc(c, start, end, cross(start, end))
            start = tips[-1]
            self.ends.append(start)
        self.tip = Model(tip.c, tip.r + self.shift())  # relative to curves
    def shift(self):
        """Return how far errors of places move a curve at most, in m."""
        return self.far * (self.errors["roll"] + self.errors["tilt"] + 1e-14) + self.errors["depth"]
    def place(self, point, before):
        """Return the task coordinates of a point of the problem, and its tip (3, 1)."""
        if point["task"]:
            place = {name: point["task"].get(name, x) for name, x in before.items()}
            u = self.boxes.pointing(place["roll"], place["tilt"])
            return place, u * (place["depth"] * self.sign)
        if point["joints"]:
            depth, u = point["joints"][3] * self.sign, self.boxes.posed(point["joints"])
            tip = u * point["joints"][3]
        else:
            tip, depth = given(point["tip"]), math.hypot(*point["tip"])
            u = unit(tip) * self.sign
        place, errors = self.boxes.coordinates(u, constant(np.array([depth]), 2 * U))
        place = {name: float(x[0]) for name, x in place.items()}
        self.errors = {name: x + float(errors[name][0]) for name, x in self.errors.items()}
        turns = round((before["roll"] - place["roll"]) / (2 * math.pi))
        return {**place, "roll": place["roll"] + turns * 2 * math.pi}, tip
    def on(self, near):
        """Return choices: the tip is at most `near` from a curve, if it is on its extension.

        D is the distance from the extension. A tip e beyond an end is at most D + 2e + shift from
        the curve, which is at most D + n/1000 with n = near if e ≤ 0.0004 n and shift ≤ 0.0002 n,
        and (D + n/1000)² ≤ 1.001 D² + 0.001001 n². D witnesses.
        """
        return [(ball(square, near, 0.5), ball(square * 1.001 + 0.00101 * near**2, near, 0.5),
                 *((x * (2500 / near) - 1.0) * STEEP for x in beyond))
                for square, *beyond in self.curves]
    def straight(self, start, end):
        """Return (d − δd/2)² (δψ² + δφ²) + δd² ≥ D² for a straight line in roll, tilt and depth.

        δ is what a coordinate differs from its line, at the same value of the coordinate that
        changes most. A change e of the latter moves the tip by at most 3e times its weight. For
        p = d u and c = d′ u′, |p − c|² = (d − d′)² + d d′ |u − u′|², d d′ ≤ (d + d′)²/4, and
        |u − u′|² ≤ δψ² + δφ².
        """
        weights = {"roll": self.far, "tilt": self.far, "depth": 1.0}
        change = {name: end[name] - x for name, x in start.items()}
        main = max(change, key=lambda name: weights[name] * abs(change[name]))
        moved = {name: x - start[name] for name, x in self.task.items()}
        slope = {name: x / change[main] if change[main] else 0.0 for name, x in change.items()}
        off = {name: x - moved[main] * slope[name] if name != main else x * 0.0
               for name, x in moved.items()}
        angles = off["roll"] * off["roll"] + off["tilt"] * off["tilt"]
        middle = self.depth - off["depth"] * 0.5
        square = middle * middle * angles + off["depth"] * off["depth"]
        scale = math.copysign(1.5 * weights[main], change[main])
        if not self.shift() <= 0.0002 * OFF:
            square = square * math.inf
        return square, moved[main] * -scale, (moved[main] - change[main]) * scale
    def segment(self, start, end):
        """Return D² and how far the tip is beyond both ends of a segment."""
        x, along = self.tip - start, unit(end - start)
        position = dot(x, along)
        off = x - along * position
        return dot(off, off), -position, position - dot(end - start, along)
    def arc(self, centre, start, end, normal):
        """Return D² = z² + (ρ − R)² and ρ sin θ beyond the ends θ = 0 and A of an arc.

        start, end: relative to the centre. Of an arc above 180°, either end suffices.
        """
        x, normal = self.tip - centre, unit(normal)
        z, inverse = dot(normal, x), power(dot(start, start), -0.5)
        first, second = start * inverse, cross(normal, start) * inverse
        gap = power(dot(x, x) - z * z, 0.5) - dot(first, start)
        square, c, s = z * z + gap * gap, dot(first, x), dot(second, x)
        angle = math.atan2(*(dot(y, end).c[0, 0] for y in (second, first))) % (2 * math.pi)
        if angle < 1e-3:
            square = square * math.inf
        sine, cosine = sin_cos(given(angle))
        ends = -s, s * cosine - c * sine
        return [(square, *ends)] if angle < math.pi else [(square, x) for x in ends]
def circle(a, b, c):
    """Return the centre of the circle through three points, a and c relative to it, its normal."""
    u, v = b - a, c - a
    n = cross(u, v)
    radius = (cross(n, u) * dot(v, v) + cross(v, n) * dot(u, u)) * power(dot(n, n) * 2.0, -1)
    centre = a + radius
    return centre, -radius, c - centre, n
def ball(square, radius, weight):
    """Return weight (x²/r² − 1) for the square x² of a distance."""
    return (square * (1 / radius**2) - 1.0) * weight
def integral(rate, half):
    """Return the integral of a rate from s = −1. The product covers the rounding of c."""
    powers = np.arange(1.0, len(rate.c) + 1).reshape(-1, *[1] * rate.r.ndim)
    c = rate.c / powers
    first = (c * (-1.0) ** (powers + 1)).sum(0)
    return Model(np.concatenate([first[None], c]), rate.r * 2) * half
def arrival(b, e, start, stop, least):
    """Return the time when a function first reaches `least`, or at most SHORT later. inf: never."""
    while (b.max(0) + e >= least).any():
        k = (b.max(0) + e >= least).argmax()
        if b[:, k].min() - e[k] >= least or stop[k] - start[k] <= SHORT:
            return start[k] if b[0, k] - e[k] >= least else stop[k]
        b = np.concatenate([halves(b[:, [k]]), b[:, k + 1:]], 1)
        middle = (start[k] + stop[k]) / 2
        start, stop = (np.append(x, y[k + 1:]) for x, y in (
            ([start[k], middle], start), ([middle, stop[k]], stop)))
        e = np.append([e[k] + (N + 1) * U * np.abs(b[:, :2]).max()] * 2, e[k + 1:])
    return math.inf

def both(x, low, high):
    """Return (functions, limit, side, value) for −x ≤ −low and x ≤ high: side·value ≤ limit."""
    return ([x], high, 1.0, float), ([-x], -low, -1.0, float)
def tilt(axial, side, low, high):
    """Return the same for a tilt φ with the sign `side` by cos φ."""
    near, far = (low, high) if side > 0 else (-high, -low)
    return (([-axial], far, side, lambda x: math.acos(min(max(-x, -1), 1))),
            ([axial], -near, -side, lambda x: -math.acos(min(max(x, -1), 1))))
def angle(c, s, low, high):
    """Return the same for an angle ψ in (−π, π] by sin(ψ − high) ≤ 0 and sin(low − ψ) ≤ 0.

    Both hold in a range below π, and cos(ψ − low) ≥ 0 in a narrow one. In a wide range, one of them
    holds. An empty range stays open.
    """
    low, high = max(low, -math.pi), min(high, math.pi)
    (s_low, c_low), (s_high, c_high) = (sin_cos(given(x)) for x in (low, high))
    over, under = s * c_high - c * s_high, c * s_low - s * c_low
    turned = -c * c_low - s * s_low
    above, below = ((lambda x, end=end: end + math.asin(min(max(x, -1), 1)))
                    for end in (high, -low))
    if low > high or high - low > math.pi:
        return (([over, under] if low <= high else [c * math.inf], high, 1.0, above),)
    narrow = (([turned], 0.0, 1.0, float),) if high - low < 0.5 else ()
    return ([over], high, 1.0, above), ([under], -low, -1.0, below), *narrow
def root(x):
    """Return the root of a number that is negative only by rounding."""
    return math.sqrt(max(x, 0.0))
def prove(plan: dict) -> list:
    """Return the claims about every limit of a plan, plan.json as read by json."""
    with np.errstate(all="ignore"):
        proof = Proof(plan)
        for j, joint in enumerate(proof.robot["joints"]):
            proof.joint(j, joint)
        proof.promises(*proof.task())
        proof.breaks()
    unknown = [(line["name"], line["joint"]) for line in plan["certificate"]["limits"]]
    unknown += [("stop_travel", None)] if proof.problem.get("stop_travel") else []
    laws = [x["drive"]["friction"] for x in proof.robot["joints"] if x["drive"] and x["motor"]]
    if proof.problem["friction"] and any(x["posterior"] or x["covariance"] for x in laws):
        unknown.append(("friction", None))  # statistical sets of friction parameters
    for key in unknown:
        if key not in proof.parts:
            proof.add(key, (-math.inf, math.inf), 0.0, half=1.0)
    return [claim(*key, parts) for key, parts in proof.parts.items()]
def claim(name, joint, parts):
    """Return the claim that follows from all bounds of one limit. Only a finite one is proven."""
    low, high = (max(part[0][k] for part in parts) for k in (0, 1))
    _, limit, half, time, side = max(parts, key=lambda part: part[0][1])
    if any(math.isnan(x) for part in parts for x in part[0]):
        raise ValueError(f"{name} of {joint} is not a number")
    verdict = "PROVEN" if high <= TOLERANCE else "REFUTED" if low > TOLERANCE else "OPEN"
    ends = sorted(side * (limit + x * half) for x in (low, high))
    return Claim(name, joint, *ends, limit=side * limit, time=time, excess=high, verdict=verdict)
def table(claims: list) -> list:
    """Return the claims as lines of text."""
    return [f"{c.name:18} {c.joint or '':10} {c.low:+.10e} … {c.high:+.10e}  "
            f"limit {c.limit:+.10e}  at {c.time:.6f} s  {c.verdict}" for c in claims]

def finite(text: str) -> float:
    """Return a number of the plan, which must be finite."""
    if not math.isfinite(float(text)):
        raise ValueError(f"{text} is not a finite number")
    return float(text)

if __name__ == "__main__":
    as_json = sys.argv[2:] == ["--json"]
    if len(sys.argv) != 2 + as_json:
        print("usage: python prove.py plan.json [--json]", file=sys.stderr)
        sys.exit(2)
    try:
        with open(sys.argv[1], encoding="utf-8") as file:
            claims = prove(json.load(file, parse_float=finite, parse_constant=finite))
    except (OSError, ValueError, LookupError, TypeError) as error:
        reason = f"{type(error).__name__}: {error}"
        print(f"{sys.argv[1]} cannot be read as a plan ({reason})", file=sys.stderr)
        sys.exit(2)
    if as_json:
        print(json.dumps([dict(zip(FIELDS, c, strict=True)) for c in claims]))
    else:
        print(*table(claims), sep="\n")
    verdicts = {c.verdict for c in claims}
    sys.exit(1 if "REFUTED" in verdicts else 0 if verdicts == {"PROVEN"} else 4)
