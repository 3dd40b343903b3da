"""The posterior of a drive's friction: which sets of parameters a torque–velocity map leaves equally likely.

The mean torque of recording k at mean speed w_k is τ(w_k; θ) + e_k, e ~ N(0, s² R_c). A share c of the scatter is a
departure from the law that recordings of near speed have in common, R_c = (1 − c) I + c K, K_kl = exp(−|ln w_k / w_l| / L)
in one direction, 0 across; the rest is a recording's own [3]. Before anything is measured, ln θ_i ~ N(ln c_i, d_i²), wide
enough for drives of this kind; a constant load beside the payload is N(0, d²); s is known to its order of magnitude s₀
alone, c is one of SHARES. With s and c integrated out

    p(θ | τ) ∝ p(θ) · Σ_c p(c) |R_c|^(−1/2) (ν s₀² + eᵀ R_c⁻¹ e)^(−(n + ν)/2),

sampled in z_i = (ln θ_i − ln c_i) / d_i by an ensemble of walkers: stretch moves [1] and differences of walkers [2].
Nothing bounds θ but its sign, so that no interval ends at a bound.

[1] J. Goodman, J. Weare, Ensemble samplers with affine invariance, Comm. App. Math. Comp. Sci. 5, 2010.
[2] C. J. F. ter Braak, A Markov chain Monte Carlo version of the genetic algorithm differential evolution,
    Stat. Comput. 16, 2006.
[3] M. C. Kennedy, A. O'Hagan, Bayesian calibration of computer models, J. R. Stat. Soc. B 63, 2001.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ssm_planner.dynamics.transmission import mesh_coefficients
from ssm_planner.identification.parameters import TYPICAL_MU, map_torque, with_parameters
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.posterior import LOAD_OFFSET, Posterior
from ssm_planner.typing import Array, Indices

SPREADS = {
    "b_c": 1.0,
    "b_v": 1.5,
    "mu": 0.5,
    "b_oc": 1.5,
    "b_ov": 1.5,
    "preload": 0.5,
    "mu_stribeck": 1.0,
    "stribeck_speed": 1.2,
}
"""Standard deviation of ln θ before anything is measured."""
LOAD_SPREAD = 0.3
"""Of the constant load, as a share of the payload or of the effort that the measured friction could be."""
DEGREES = 2.0
"""ν: how many recordings the guess s₀ of the scatter counts for."""
SHARES = {0.0: 0.5, 0.5: 0.25, 0.8: 0.25}
"""What the share c may be, each with its probability before anything is measured."""
DRAWS = 1000
WALKERS, WARM_UP, STEPS, FEWEST_STEPS, KEPT_EVERY = 100, 400, 800, 200, 10
"""Steps after the warm-up: for DRAWS sets, in proportion for fewer, and at least."""
FOLDS = 6
PAYS = 0.5
"""Standard errors by which a law with more parameters has to predict better."""
LENGTH = 2.0
"""L: ratio of speeds, as a logarithm, over which departures from the law change."""
SLOWEST = 0.1
"""Motor speed below which departures are taken as there, rad/s: some 1 rpm, what recorders resolve."""
SCATTER_DEGREES = 3.0
"""Of the t-distribution of a recording's departure: one in twenty stands apart by far more than the others."""
NOTHING = 1e-5
"""Errors below this share of the torque range do not count."""
SEED = 20_210_521


@dataclass(frozen=True, eq=False)
class MapModel:
    """One friction law on one torque–velocity map; w, tau, weight (points,), SI."""

    drive: Drive
    law: str
    names: tuple[str, ...]
    """Parameters to find, in the order of z."""
    fixed: Mapping[str, float]
    reference: Mapping[str, float]
    """Values about which parameters are expected."""
    w: Array
    tau: Array
    weight: Array
    """Factor of each residual: 1, less for outliers."""
    load: float
    """Effort on the output, an offset that is known included, N·m or N."""
    scatter: float
    """s₀, N·m."""

    @cached_property
    def prior(self) -> tuple[Array, Array]:
        """Centres and standard deviations (k,) of ln θ; of the load offset itself."""
        friction, fastest = 0.5 * float(np.mean(np.abs(self.tau))), float(np.abs(self.w).max())
        effort = friction / float(mesh_coefficients(self.drive, TYPICAL_MU)[0])
        centre = {
            "b_c": 0.5 * friction,
            "b_v": 0.2 * friction / fastest,
            "mu": TYPICAL_MU,
            "b_oc": 0.2 * effort,
            "b_ov": 0.2 * effort * self.drive.ratio / fastest,
            "preload": self.drive.preload or effort,
            "mu_stribeck": 0.03,
            "stribeck_speed": 0.05 * fastest,
        }
        centre |= {
            name: value for name, value in self.reference.items() if name in centre and value > 0
        }
        spread = {**SPREADS, LOAD_OFFSET: LOAD_SPREAD * max(abs(self.load), effort)}
        centres = [0.0 if name == LOAD_OFFSET else math.log(centre[name]) for name in self.names]
        return np.array(centres), np.array([spread[name] for name in self.names])

    def parameters(self, z: Array) -> dict[str, Array]:
        """Parameters by name, (sets, 1) each, of z (sets, k)."""
        centre, spread = self.prior
        x = centre + z * spread
        return {
            name: x[:, [i]] if name == LOAD_OFFSET else np.exp(x[:, [i]])
            for i, name in enumerate(self.names)
        }

    def z_of(self, name: str, value: float) -> float:
        """The coordinate at which a parameter, not the load offset, has a value."""
        i = self.names.index(name)
        centre, spread = self.prior
        return (math.log(value) - float(centre[i])) / float(spread[i])

    def torque(self, z: Array, w: Array | None = None) -> Array:
        """(sets, points) motor torque of steady motion at speeds w (points,), N·m, for z (sets, k)."""
        values: dict[str, Any] = {**self.fixed, **self.parameters(z)}
        offset = values.pop(LOAD_OFFSET, 0.0)
        load = self.load + (0.0 if LOAD_OFFSET in self.fixed else offset)
        torque = map_torque(
            with_parameters(self.drive, self.law, values), self.w if w is None else w, load
        )
        return np.broadcast_to(torque, (len(z), np.shape(torque)[-1]))

    def residual(self, z: Array) -> Array:
        """(sets, points) weighted difference of torque and measured torque, N·m, for z (sets, k)."""
        return np.asarray((self.torque(z) - self.tau) * self.weight)

    @cached_property
    def _whitened(self) -> tuple[Array, Array]:
        """(points, shares · points) that makes residuals independent, share by share; (shares,) ln p(c) |R_c|^(−1/2)."""
        related, one = correlation(self.w, self.w), np.eye(len(self.w))
        roots = [np.linalg.cholesky((1 - share) * one + share * related) for share in SHARES]
        logs = [
            math.log(p) - np.log(np.diag(root)).sum()
            for p, root in zip(SHARES.values(), roots, strict=True)
        ]
        return np.concatenate([np.linalg.inv(root).T for root in roots], axis=1), np.array(logs)

    def shares(self, z: Array) -> tuple[Array, Array]:
        """For z (sets, k): logarithms of the likelihood of each share c, and ν s₀² + eᵀ R_c⁻¹ e in N²·m², (sets, shares)."""
        whitener, logs = self._whitened
        white = (self.residual(z) @ whitener).reshape(len(z), len(logs), -1)
        square = np.sum(white**2, axis=2) + DEGREES * self.scatter**2
        return logs - 0.5 * (len(self.w) + DEGREES) * np.log(square), square

    def log_posterior(self, z: Array) -> Array:
        """(sets,) up to a constant, for z (sets, k); −inf where the law overflows."""
        with np.errstate(all="ignore"):
            value = np.logaddexp.reduce(self.shares(z)[0], axis=1) - 0.5 * np.sum(z * z, axis=1)
        return np.where(np.isfinite(value), value, -np.inf)

    def without(self, points: Indices) -> MapModel:
        """The model on all other points; what is expected of parameters stays."""
        left = np.setdiff1d(np.arange(len(self.w)), points)
        made = replace(self, w=self.w[left], tau=self.tau[left], weight=self.weight[left])
        made.__dict__["prior"] = self.prior
        return made


def most_likely(
    model: MapModel, start: Array | None = None, held: tuple[int, float] | None = None
) -> Array:
    """z (k,) of the largest posterior, from `start` (k,) or from several starts; held: a coordinate and its value."""
    from scipy.optimize import least_squares

    k, rng = len(model.names), np.random.default_rng(SEED)
    free = np.array([held is None or i != held[0] for i in range(k)], dtype=bool)
    starts = [start] if start is not None else [np.zeros(k), *0.7 * rng.standard_normal((3, k))]
    found = []
    for first in starts:
        z = np.array(first, dtype=float)
        if held is not None:
            z[held[0]] = held[1]
        scatter = 0.02 * float(np.ptp(model.tau)) if start is None else _scatter(model, z)
        for _ in range(3 if start is None else 2):
            if free.any():
                z = _nearest(model, z, free, scatter, least_squares)
            scatter = _scatter(model, z)
        found.append(z)
    return max(found, key=lambda z: float(model.log_posterior(z[None])[0]))


def _scatter(model: MapModel, z: Array) -> float:
    """The most likely scatter at z, N·m."""
    left = model.residual(z[None])[0]
    square = float(left @ left) + DEGREES * model.scatter**2
    return max(math.sqrt(square / (len(left) + DEGREES)), 1e-9 * float(np.ptp(model.tau)))


def _nearest(
    model: MapModel, z: Array, free: Array, scatter: float, least_squares: object
) -> Array:
    """Least squares of residuals over the scatter and of z, from z (k,), over the coordinates that are free."""

    def full(part: Array) -> Array:
        whole = z.copy()
        whole[free] = part
        return whole

    def misfit(part: Array) -> Array:
        return np.concatenate([model.residual(full(part)[None])[0] / scatter, part])

    def slope(part: Array) -> Array:
        steps = 1e-6 * np.eye(len(z))[free]
        values = model.residual(np.concatenate([full(part)[None], full(part) + steps])) / scatter
        return np.concatenate([((values[1:] - values[0]) / 1e-6).T, np.eye(len(part))])

    found = least_squares(
        misfit, z[free], jac=slope, method="lm", xtol=1e-9, ftol=1e-9, max_nfev=60
    )  # type: ignore[operator]
    return full(found.x)


def blind_errors(model: MapModel, z: Array) -> Array:
    """(points,) weighted errors of recordings left out, fold by fold, each fold fitted from z (k,); N·m."""
    rng, count = np.random.default_rng(SEED), len(model.w)
    folds = min(FOLDS, count)
    fold = np.empty(count, dtype=int)
    for block in np.array_split(np.argsort(model.w), -(-count // folds)):
        fold[block] = rng.permutation(folds)[: len(block)]
    errors = np.zeros(count)
    for k in range(folds):
        out = np.flatnonzero(fold == k)
        if len(out):
            part = model.without(out)
            predicted = model.torque(most_likely(part, z)[None], model.w[out])[0]
            errors[out] = (predicted - model.tau[out]) * model.weight[out]
    return errors


def simplest(models: list[MapModel], errors: list[Array]) -> int:
    """Which model predicts best what it has not seen: the one with the fewest parameters that is not clearly worse.

    errors: blind errors (points,) of each model.
    """
    best = min(range(len(models)), key=lambda i: float(np.mean(errors[i] ** 2)))
    for i in sorted(range(len(models)), key=lambda i: len(models[i].names)):
        gap = errors[i] ** 2 - errors[best] ** 2
        if (
            np.mean(gap)
            <= PAYS * np.std(gap) / math.sqrt(len(gap)) + (NOTHING * np.ptp(models[i].tau)) ** 2
        ):
            return i
    return best


def sample(model: MapModel, z: Array, draws: int) -> tuple[Array, Array, Array]:
    """Equally likely z (draws, k), scatters (draws,) in N·m and shares c (draws,), from walkers about z (k,)."""
    rng, k = np.random.default_rng(SEED), len(z)
    root = np.linalg.cholesky(covariance_near(model, z))
    walkers = z + rng.standard_normal((WALKERS, k)) @ root.T
    height = model.log_posterior(walkers)
    kept, halves = [], (np.arange(WALKERS // 2), np.arange(WALKERS // 2, WALKERS))
    for step in range(WARM_UP + max(FEWEST_STEPS, STEPS * draws // DRAWS)):
        for movers, others in (halves, halves[::-1]):
            proposed, bonus = _moved(walkers[movers], walkers[others], rng)
            reached = model.log_posterior(proposed)
            accepted = np.log(rng.random(len(movers))) < reached - height[movers] + bonus
            walkers[movers[accepted]], height[movers[accepted]] = (
                proposed[accepted],
                reached[accepted],
            )
        if step >= WARM_UP and step % KEPT_EVERY == 0:
            kept.append(walkers.copy())
    found = rng.permutation(np.concatenate(kept))[:draws]
    logs, square = model.shares(found)
    share = np.argmax(logs + rng.gumbel(size=logs.shape), axis=1)
    scatter = np.sqrt(
        square[np.arange(len(found)), share] / rng.chisquare(len(model.w) + DEGREES, len(found))
    )
    return found, scatter, np.array(list(SHARES))[share]


def _information(model: MapModel, z: Array) -> Array:
    """(k, k) what the data alone say of z near z (k,): the inverse of its covariance."""
    values = model.residual(np.concatenate([z[None], z + 1e-5 * np.eye(len(z))])) / _scatter(
        model, z
    )
    jacobian = (values[1:] - values[0]) / 1e-5
    return np.asarray(jacobian @ jacobian.T)


def covariance_near(model: MapModel, z: Array) -> Array:
    """(k, k) of the posterior near z (k,), were it normal."""
    return np.asarray(np.linalg.inv(_information(model, z) + np.eye(len(z))))


def log_evidence(model: MapModel, z: Array) -> float:
    """ln p(τ) of the law, by Laplace's approximation about the most likely z (k,), up to a constant that laws share."""
    return float(
        model.log_posterior(z[None])[0] + 0.5 * np.linalg.slogdet(covariance_near(model, z))[1]
    )


def data_correlation(model: MapModel, z: Array) -> Array:
    """(k, k) correlation of the parameters near z (k,) were next to nothing expected of them: ±1 where the data give
    parameters only together."""
    covariance = np.linalg.inv(_information(model, z) + NOTHING * np.eye(len(z)))
    deviation = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(deviation, deviation))


def _moved(walkers: Array, others: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Proposals (walkers, k) and the logarithm of their densities' ratio (walkers,)."""
    count, k = walkers.shape
    if rng.random() < 0.5:
        stretch = np.asarray((rng.random(count) + 1.0) ** 2 / 2.0)
        anchor = others[rng.integers(count, size=count)]
        return anchor + (walkers - anchor) * stretch[:, None], (k - 1) * np.log(stretch)
    first, second = (rng.integers(count, size=count) for _ in range(2))
    length = 1.0 if rng.random() < 0.1 else 2.38 / math.sqrt(2 * k)
    return walkers + length * (others[first] - others[second]) + 1e-4 * rng.standard_normal(
        (count, k)
    ), np.zeros(count)


def correlation(v: Array, w: Array) -> Array:
    """(points, others) K of the departures at motor speeds v (points,) and w (others,), rad/s."""
    apart = np.abs(
        np.log(np.maximum(np.abs(v), SLOWEST))[:, None] - np.log(np.maximum(np.abs(w), SLOWEST))
    )
    return np.where(np.sign(v)[:, None] == np.sign(w), np.exp(-apart / LENGTH), 0.0)


def expected_departure(posterior: Posterior, w: Array) -> tuple[Array, Array]:
    """At motor speeds w (samples,), recorded or not: factors (samples, recordings) of the recordings' departures in the
    one expected there, and what stays open of it beside the scatter, (samples,).

    Away from the recorded speeds of a direction that grows with the logarithm of the speed: nothing there tested the law.
    """
    speeds, common = np.array(posterior.speeds), posterior.common
    if not len(speeds):
        return np.zeros((len(w), 0)), np.ones(len(w))
    near = common * correlation(w, speeds)
    factors = np.linalg.solve(
        common * correlation(speeds, speeds) + (1 - common) * np.eye(len(speeds)), near.T
    ).T
    left = np.sqrt(np.maximum(1.0 - np.sum(factors * near, axis=1), 0.0))
    return np.asarray(factors), np.asarray(left * (1.0 + _apart(posterior, w)))


def _apart(posterior: Posterior, w: Array) -> Array:
    """(samples,) how far motor speeds w are from the nearest recorded in the same direction: |ln| of their ratio.

    1 in a direction that was not recorded.
    """
    speeds = np.array(posterior.speeds)
    logs, recorded = (np.log(np.maximum(np.abs(v), SLOWEST)) for v in (w, speeds))
    apart = np.abs(logs[:, None] - recorded)
    nearest = np.where(np.sign(w)[:, None] == np.sign(speeds), apart, np.inf).min(axis=1)
    return np.where(np.isfinite(nearest), nearest, 1.0)


def outside(posterior: Posterior, w: Array) -> Array:
    """(samples,) how far motor speeds w lie outside those of the recordings in the same direction: |ln| of their ratio.

    1 in a direction that was not recorded.
    """
    speeds = np.array(posterior.speeds)
    logs, recorded, apart = (
        np.log(np.maximum(np.abs(w), SLOWEST)),
        np.log(np.abs(speeds)),
        np.ones(len(w)),
    )
    for sign in np.unique(np.sign(speeds)):
        here, known = np.sign(w) == sign, recorded[np.sign(speeds) == sign]
        apart[here] = np.maximum(
            np.maximum(known.min() - logs[here], logs[here] - known.max()), 0.0
        )
    return apart


def prior_pull(covariance: Array) -> Array:
    """(k,) how far the mean of each parameter follows what was expected of all, in its standard deviations.

    Were every expectation moved by one standard deviation of its own, the posterior of a linear model would move by the
    covariance (k, k) of z: row by row in units of √cov_ii. Small values mean that the data alone decide.
    """
    return np.asarray(np.linalg.norm(covariance, axis=1) / np.sqrt(np.diag(covariance)))
