"""The tick put together from `formulas`, its tables, and its metrics."""

import functools
from collections.abc import Callable

import numpy as np

from peers import formulas
from peers.problem import METRICS, Problem


def make_plan(problem: Problem, ticks: int) -> tuple[np.ndarray, ...]:
    """Everything that depends on time alone, ticks first: task, funnels and sea.

    Returns:
        The task (depth, its rate, gliding angle, heading), the funnels (for each
        channel P, P', P'' and whether settled), and the force with its change over the
        tick.
    """
    kind = problem.sea.dtype.type
    time = np.arange(ticks).astype(kind) * problem.dt
    start, rate = problem.schedule["start"], problem.schedule["depth_rate"]
    number = np.searchsorted(start, time, side="right") - 1
    clock = time - start[number]
    begun = np.concatenate([np.zeros(1, kind), np.cumsum(rate[:-1] * np.diff(start))])
    rows = [
        begun[number] + rate[number] * clock,
        rate[number],
        problem.schedule["gliding_angle"][number],
        problem.schedule["heading"][number],
    ]
    funnels = [_funnel(problem, channel, clock) for channel in range(3)]
    force = problem.sea[:, : ticks + 1].T
    sea = np.stack([force[:-1], np.diff(force, axis=0)], axis=1)
    return np.stack(rows, axis=1), np.stack(funnels, axis=1), sea


def _funnel(problem: Problem, channel: int, clock: np.ndarray) -> np.ndarray:
    """P = sech(sech(P₀) T/(T − t*)) + P_∞ with its rates, and whether t* ≥ T."""
    kind = clock.dtype.type
    slope = 1 / np.cosh(problem.initial[channel])
    duration, final = problem.settling_time[channel], problem.final_bound[channel]
    falling = clock < duration * (1 - slope / kind(40))
    z = duration / (duration - np.where(falling, clock, kind(0)))
    z1 = z * z / duration
    z2 = 2 * z * z1 / duration
    sech, tanh = 1 / np.cosh(slope * z), np.tanh(slope * z)
    y1, y2 = slope * z1, slope * z2
    rate = -sech * tanh * y1
    curve = sech * ((tanh * tanh - sech * sech) * y1 * y1 - tanh * y2)
    value, rate, curve = (np.where(falling, x, kind(0)) for x in (sech, rate, curve))
    return np.stack([value + final, rate, curve, (clock >= duration).astype(kind)], 1)


def constants(problem: Problem) -> tuple[np.ndarray, ...]:
    """What the tick needs of a problem: design, gains, observer and the rest."""
    names = ("k1", "k2", "rho", "mu", "lower", "upper", "tail")
    laws = np.stack([problem.shared[name] for name in names], axis=1)
    dt = problem.dt
    observer = [dt * problem.proportional, dt * dt * problem.integral, problem.stretch]
    rest = [problem.dt, problem.smoothing, problem.observer_smoothing]
    return (
        problem.design,
        laws,
        problem.damping,
        problem.limit,
        np.stack(observer, axis=1),
        np.concatenate(rest),
    )


def empty(problem: Problem, lanes: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    """States, observer, integrals, command, sums, and room for a slope and a stage."""
    kind = problem.sea.dtype
    sizes = (12, 6, 6, 3, 3, len(METRICS), 12, 12, 12)
    carried = tuple(np.zeros((size, *lanes), kind) for size in sizes)
    start = problem.start.reshape(-1, *(1 for _ in lanes))
    carried[0][:] = start
    carried[1][:] = start[6:]
    return carried


@functools.cache
def make_tick(dialect: formulas.Dialect, kind: type) -> Callable[..., None]:
    """The tick in one precision: changes what is carried in place."""
    forces, pushes, derivative = formulas.make_glider(dialect, kind)
    channel = formulas.make_channel(dialect, kind)
    observed = formulas.make_observer(dialect, kind)
    allocate = formulas.make_allocation(dialect, kind)
    tracking_error = formulas.make_error(dialect, kind)
    add = formulas.make_sums(dialect, kind)
    zero, half, one, third, sixth = map(kind, (0, 0.5, 1, 1 / 3, 1 / 6))
    nodes, weights = (zero, half, half, one), (sixth, third, third, sixth)

    advance = dialect.advance

    @dialect.compiled
    def tick(first, task, funnels, sea, known, c, carried):
        design, laws, damping, limit, observer, rest = known
        x, velocity, estimate, integral, held, sums, slope, stage, total = carried
        dt, delta = rest[0], rest[1]
        sp, cp, st, ct = np.sin(x[3]), np.cos(x[3]), np.sin(x[4]), np.cos(x[4])
        u, v, w, p, q, r = x[6], x[7], x[8], x[9], x[10], x[11]
        turning = (sp * q + cp * r) / ct
        e = tracking_error(task, x)
        e1 = (ct * (sp * v + cp * w) - st * u - task[1], cp * q - sp * r, turning)
        d0, a0 = channel(laws[0], delta, funnels[0], e[0], e1[0], integral[0])
        d1, a1 = channel(laws[1], delta, funnels[1], e[1], e1[1], integral[1])
        d2, a2 = channel(laws[2], delta, funnels[2], e[2], e1[2], integral[2])
        drift = forces(design, u, v, w, p, q, r)
        wanted = allocate(
            design, damping, x, drift, estimate, held[2], d0, d1, d2, sp, cp, st, ct
        )
        mb = np.minimum(np.maximum(wanted[0], -limit[0]), limit[0])
        rp = np.minimum(np.maximum(wanted[1], -limit[1]), limit[1])
        gamma = np.minimum(np.maximum(wanted[2], -limit[2]), limit[2])
        command, sliding = (mb, rp, gamma), (a0, a1, a2)
        for i in range(3):
            add(
                sums,
                9 * i,
                first,
                e[i],
                funnels[i, 0],
                funnels[i, 3],
                laws[i, 4],
                laws[i, 5],
                wanted[i],
                command[i],
                held[i],
            )
            integral[i] += dt * sliding[i]
            held[i] = command[i]
        sums[27] = np.maximum(sums[27], np.abs(x[3]))
        sums[28] = np.maximum(sums[28], np.abs(x[4]))
        push = pushes(design, sp, cp, st, ct, mb, rp, gamma)
        total[:] = x
        stage[:] = x
        for k in range(4):
            derivative(c, stage, mb, rp, gamma, sea, nodes[k], slope)
            advance(total, total, dt * weights[k], slope)
            if k < 3:
                advance(stage, x, dt * nodes[k + 1], slope)
        for i in range(6):
            m, following = design[4 + i], total[6 + i]
            b = m * (following - velocity[i])
            b = b - dt * (drift[i] + push[i] + estimate[i])
            gains = observer[i]
            y, change = observed(b, gains[0], gains[1], gains[2], rest[2])
            estimate[i] += change / dt
            velocity[i] = following - y / m
        x[:] = total

    return tick


def metrics_of(sums: np.ndarray, state: np.ndarray, ticks: int) -> np.ndarray:
    """Metrics from the sums of all members."""
    metrics = sums.copy()
    for at in (0, 9, 18):
        metrics[at : at + 3] = np.sqrt(sums[at : at + 3] / ticks)
        metrics[at + 5 : at + 9] = sums[at + 5 : at + 9] / ticks
    metrics[29] = np.isfinite(sums).all(axis=0) & np.isfinite(state).all(axis=0)
    return metrics
