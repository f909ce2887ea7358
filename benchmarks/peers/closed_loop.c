/* The closed loop in C: FxTPPC on the small-angle glider with the paper's actuation.

   The same tick as jaxglider.evaluate on a schedule of attitudes, with every saving
   that is known: members side by side as lanes (structure of arrays), polynomial
   mathematics, coefficients divided by their inertia beforehand, tables of all that
   depends on time alone, the stages' sines by angle addition, and the observer's root
   by one step of third order from a good start.

   -DREAL=float or -DREAL=double -DDOUBLE, -DLANES=16 or so; -DPLAIN for the functions
   of the C library and the root as jaxglider finds it. */

#include <stdlib.h>

#include "maths.h"

enum { DEPTH, PITCH, HEADING, CHANNELS };
enum { X, Y, Z, PHI, THETA, PSI, U, V, W, P, Q, R, STATES };
enum { AXES = 6 };
enum { MASS, OFFSET, BUOYANCY_AT, GRAVITY, INERTIA, DRAG = INERTIA + AXES, LIFT_OFFSET,
       LIFT, SIDE_FORCE, ROLL_MOMENT, ROLL_DAMPING, PITCH_OFFSET, PITCH_MOMENT,
       PITCH_DAMPING, YAW_MOMENT, YAW_DAMPING, PARAMETERS };
enum { ERROR2, EFFORT2, CHANGE2, MAX_ERROR, MAX_SETTLED, OUTSIDE, SATURATED, CROWDING,
       EXCESS, SUMS };
enum { METRICS = CHANNELS * SUMS + 3 };

/* All that the members share; peers/c.py has the same fields in the same order. */
struct shared {
    real design[PARAMETERS], start[STATES], dt;
    real k1[CHANNELS], k2[CHANNELS], rho[CHANNELS], mu[CHANNELS];
    real damping[CHANNELS], smoothing;
    real initial[CHANNELS], final_bound[CHANNELS], settling_time[CHANNELS];
    real lower[CHANNELS], upper[CHANNELS], tail[CHANNELS];
    real proportional[AXES], integral[AXES], stretch[AXES], observer_smoothing;
    real limit[CHANNELS];
};

/* Piecewise constant task. */
struct schedule {
    const real *start, *gliding_angle, *heading, *depth_rate;
    int64_t segments;
};

/* What is known of a tick beforehand. */
struct funnel { real width, inverse, rate, curve, settled; };
struct plan {
    real depth, depth_rate, gliding_angle, heading;
    struct funnel funnel[CHANNELS];
    real force[3][AXES]; /* at the start, in the middle, at the end */
};

/* Coefficients of the accelerations, each divided by the inertia of its row; s = |u|. */
#define COEFFICIENTS(_)                                                               \
    _(u_1) _(v_1) _(w_1) _(p_1) _(q_1) _(r_1) _(weight) _(arm) _(gravity) _(buoyancy) \
    _(u_vr) _(u_wq) _(u_sw) _(u_su) _(v_wp) _(v_ur) _(v_sv) _(w_uq) _(w_vp) _(w_su)   \
    _(w_sw) _(p_vw) _(p_qr) _(p_puu) _(p_sv) _(q_uw) _(q_sw) _(q_pr) _(q_uu) _(q_quu) \
    _(r_uv) _(r_sv) _(r_pq) _(r_ruu)
#define SCALAR(name) real name;
#define LANE(name) real name[LANES];
#define OF_LANE(name) lanes->name[l],
#define TO_LANE(name) lanes->name[l] = one.name;
struct vehicle { COEFFICIENTS(SCALAR) };
struct vehicles { COEFFICIENTS(LANE) };

/* Gains as the law uses them. */
struct law {
    real k1, k2, k12, a, a_prime, b, b_prime, power, smoothing2;
    real lower, upper, low, high, inverse_span, over_upper, over_lower, limit;
};
struct observer_gains {
    real constant, near1, far1, near2, far2, smoothing2, bend2, over_dt, inverse_inertia;
};

struct block {
    real state[STATES][LANES], expected[AXES][LANES], disturbance[AXES][LANES];
    real integral[CHANNELS][LANES], held[CHANNELS][LANES];
    real sums[METRICS][LANES];
    struct vehicles vehicles;
} __attribute__((aligned(64)));

static struct vehicle normalised(const real *c)
{
    const real *m = c + INERTIA;
    return (struct vehicle){
        1 / m[0], 1 / m[1], 1 / m[2], 1 / m[3], 1 / m[4], 1 / m[5],
        c[MASS] * c[GRAVITY], c[MASS] * c[GRAVITY] * c[OFFSET], c[GRAVITY],
        c[GRAVITY] * c[BUOYANCY_AT],
        m[1] / m[0], -m[2] / m[0], c[LIFT_OFFSET] / m[0], -c[DRAG] / m[0],
        m[2] / m[1], -m[0] / m[1], (c[SIDE_FORCE] - c[DRAG]) / m[1],
        m[0] / m[2], -m[1] / m[2], -c[LIFT_OFFSET] / m[2], -(c[DRAG] + c[LIFT]) / m[2],
        (m[1] - m[2]) / m[3], (m[4] - m[5]) / m[3], c[ROLL_DAMPING] / m[3],
        c[ROLL_MOMENT] / m[3],
        (m[2] - m[0]) / m[4], c[PITCH_MOMENT] / m[4], (m[5] - m[3]) / m[4],
        c[PITCH_OFFSET] / m[4], c[PITCH_DAMPING] / m[4],
        (m[0] - m[1]) / m[5], c[YAW_MOMENT] / m[5], (m[3] - m[4]) / m[5],
        c[YAW_DAMPING] / m[5]};
}

struct velocity { real u, v, w, p, q, r; };
struct attitude { real sp, cp, st, ct, ss, cs, side, down; };
struct rates { real x, y, z, phi, theta, psi; };
/* B U + E: what the command does, to be multiplied by `side`, `down` and sin theta. */
struct push { real u_st, v_side, w_down, p_down, p_side, q_down, q_st, r_side, r_st; };

INLINE struct push pushed(const struct vehicle *c, real mb, real rp, real gamma)
{
    real g2 = gamma * gamma;
    real sine = gamma * (1 + g2 * (g2 * (real)(1.0 / 120) - (real)(1.0 / 6)));
    real cosine = g2 * (g2 * (real)(1.0 / 24) - (real)0.5);
    real lift = c->gravity * mb, moment = c->buoyancy * mb + c->weight * rp;
    return (struct push){
        -lift * c->u_1, lift * c->v_1, lift * c->w_1,
        -c->arm * sine * c->p_1, c->arm * (cosine - 1) * c->p_1,
        -moment * c->q_1, -c->arm * (cosine + 1) * c->q_1,
        moment * c->r_1, c->arm * sine * c->r_1};
}

/* M^-1 (C nu + D nu). */
INLINE struct velocity drifting(const struct vehicle *c, struct velocity n)
{
    real s = fabs(n.u), uu = n.u * n.u, su = s * n.u, sv = s * n.v, sw = s * n.w;
    real uv = n.u * n.v, uw = n.u * n.w;
    return (struct velocity){
        c->u_vr * n.v * n.r + c->u_wq * n.w * n.q + c->u_sw * sw + c->u_su * su,
        c->v_wp * n.w * n.p + c->v_ur * n.u * n.r + c->v_sv * sv,
        c->w_uq * n.u * n.q + c->w_vp * n.v * n.p + c->w_su * su + c->w_sw * sw,
        c->p_vw * n.v * n.w + c->p_qr * n.q * n.r + c->p_puu * n.p * uu + c->p_sv * sv,
        c->q_uw * uw + c->q_sw * sw + c->q_pr * n.p * n.r
            + (c->q_uu + c->q_quu * n.q) * uu,
        c->r_uv * uv + c->r_sv * sv + c->r_pq * n.p * n.q + c->r_ruu * n.r * uu};
}

INLINE struct velocity pushing(struct velocity f, struct push b, struct attitude a)
{
    return (struct velocity){
        f.u + b.u_st * a.st, f.v + b.v_side * a.side, f.w + b.w_down * a.down,
        f.p + b.p_down * a.down + b.p_side * a.side,
        f.q + b.q_down * a.down + b.q_st * a.st,
        f.r + b.r_side * a.side + b.r_st * a.st};
}

INLINE struct rates kinematics(struct attitude a, struct velocity n)
{
    real across = a.cp * n.v - a.sp * n.w, below = a.sp * n.v + a.cp * n.w;
    real ahead = a.ct * n.u + a.st * below;
    real psi = (a.sp * n.q + a.cp * n.r) / a.ct;
    return (struct rates){
        a.cs * ahead - a.ss * across, a.ss * ahead + a.cs * across,
        a.ct * below - a.st * n.u,
        n.p + a.st * psi, a.cp * n.q - a.sp * n.r, psi};
}

INLINE struct attitude facing(real sp, real cp, real st, real ct, real ss, real cs)
{
    return (struct attitude){sp, cp, st, ct, ss, cs, ct * sp, ct * cp};
}

INLINE struct attitude attitude_of(real phi, real theta, real psi)
{
    real sp, cp, st, ct, ss, cs;
    sine_cosine(phi, &sp, &cp);
    sine_cosine(theta, &st, &ct);
    sine_cosine(psi, &ss, &cs);
    return facing(sp, cp, st, ct, ss, cs);
}

#ifdef PLAIN
#define TURNED(a, phi, theta, psi, d) attitude_of(phi + d.phi, theta + d.theta, psi + d.psi)
#else
#define TURNED(a, phi, theta, psi, d) turned(a, d.phi, d.theta, d.psi)
/* The attitude a little later, by angle addition. */
INLINE struct attitude turned(struct attitude a, real phi, real theta, real psi)
{
    real s1, c1, s2, c2, s3, c3;
    small_sine_cosine(phi, &s1, &c1);
    small_sine_cosine(theta, &s2, &c2);
    small_sine_cosine(psi, &s3, &c3);
    return facing(a.sp * c1 + a.cp * s1, a.cp * c1 - a.sp * s1, a.st * c2 + a.ct * s2,
                  a.ct * c2 - a.st * s2, a.ss * c3 + a.cs * s3, a.cs * c3 - a.ss * s3);
}
#endif

/* One channel: minus what the law demands, and A, the integrand of its surface. */
INLINE real channel(const struct law *g, const struct funnel *f, real e, real e1,
                    real integral, real *sliding)
{
    real x = e * f->inverse, x1 = (e1 - x * f->rate) * f->inverse;
    real core = clip(x, g->low, g->high), left = g->lower + core, right = g->upper - core;
    real product = left * right, both = 1 / product, span = g->lower + g->upper;
    real slope = (real)0.5 * span * both;
    real curve = core == x ? slope * (left - right) * both : 0;
    real eps = (real)0.34657359027997264 * log_2(left * left * both) + slope * (x - core);
    real eps1 = slope * x1;
    real bend = curve * x1 * x1 - slope * (2 * x1 * f->rate + x * f->curve) * f->inverse;
    real log1 = log_2(eps * eps + g->smoothing2), log2 = log_2(eps1 * eps1 + g->smoothing2);
    real s = eps1 + integral, log3 = log_2(s * s + g->smoothing2);
    real power = exp_2(g->power * log3);
    *sliding = g->k1 * eps * (exp_2(g->a * log1) + 1 + exp_2(g->a_prime * log1)) +
               g->k2 * eps1 * (exp_2(g->b * log2) + 1 + exp_2(g->b_prime * log2));
    real reaching = g->k12 * s * (power + 1 + 1 / power);
    return (bend + *sliding + reaching) * f->width * product * g->inverse_span;
}

#ifdef PLAIN
/* y + a1 phi1(y) + a2 phi2(y) = b, as jaxglider finds it. */
INLINE real observer_root(const struct observer_gains *g, real target)
{
    real b = fabs(target), b2 = b * b, d2 = g->smoothing2, d = sqrt(d2);
    real rest = larger(b - g->near2, b * (d / (d + g->near2)));
    real k = g->constant + g->near1 / sqrt(b + d);
    real y = 2 * rest / (k + sqrt(k * k + 4 * g->far2 * rest));
    real r = sqrt(larger(y, d) + (real)0.41 * smaller(y, d));
#pragma GCC unroll 4
    for (int i = 0; i < (SINGLE ? 3 : 4); i++) {
        real q = r * r, u = g->near1 * r, v = g->far1 * r, w = g->far2 * q, q2 = q * q;
        real p = g->near2 + u + q * (g->constant + v + w), pulled = b2 * q2;
        real rise = u + q * (2 * g->constant + 3 * v + 4 * w);
        real n = (q2 - d2) * p * p - pulled;
        real slope = 2 * (n + 2 * d2 * p * p) * p + (2 * pulled + (real)0.5 * n) * rise;
        r *= clip(1 - p * n / slope, (real)0.5, 2);
    }
    real q = r * r;
    return target * q / (g->near2 + g->near1 * r + q * (g->constant + g->far1 * r + g->far2 * q));
}
#else
/* h of y h(|y|) = b, its first and, by f2, second derivative times y. */
INLINE real left_side(const struct observer_gains *g, real y, real *slope, real *f2)
{
    real q2 = y * y + g->smoothing2, iq = 1 / sqrt(q2), q = q2 * iq;
    real ir = 1 / sqrt(q), r = q * ir;
    real t1 = g->near1 * ir, t2 = g->far1 * r, t3 = g->near2 * iq, t4 = g->far2 * q;
    real h = g->constant + (t1 + t2) + (t3 + t4), lean = y * iq, m = lean * lean;
    real h1 = (real)0.5 * (t2 - t1) + (t4 - t3);
    real h2 = (real)0.25 * (t1 + t2) + (t3 + t4);
    *slope = h + m * h1;
    *f2 = lean * iq * ((3 - 2 * m) * h1 + m * h2);
    return h;
}

/* y + a1 phi1(y) + a2 phi2(y) = b. */
INLINE real observer_root(const struct observer_gains *g, real target)
{
    real b = fabs(target), b2 = b * b, slope, f2;
    real k = g->constant + g->near1 * rough_inverse_fourth_root(b2 + g->smoothing2);
    real rest = b - g->near2 * b / sqrt(b2 + g->bend2);
    real y = 2 * rest / (k + sqrt(k * k + 4 * g->far2 * rest));
#pragma GCC unroll 2
    for (int i = 0; i < (SINGLE ? 1 : 2); i++) {
        real f = y * left_side(g, y, &slope, &f2) - b;
        y -= f * slope / (slope * slope - (real)0.5 * f * f2);
    }
    return copysign(y, target);
}
#endif

/* One tick of every lane. */
static void tick(struct block *block, const struct vehicle *design,
                 const struct law *law, const struct observer_gains *gains,
                 const struct shared *all, const struct plan *plan)
{
    const struct vehicles *lanes = &block->vehicles;
    const real dt = all->dt, *inertia = all->design + INERTIA;
    real(*x)[LANES] = block->state, (*sums)[LANES] = block->sums;
#pragma GCC ivdep
    for (int l = 0; l < LANES; l++) {
        const struct vehicle true_one = {COEFFICIENTS(OF_LANE)};
        const struct velocity n = {x[U][l], x[V][l], x[W][l], x[P][l], x[Q][l], x[R][l]};
        const real phi = x[PHI][l], theta = x[THETA][l], psi = x[PSI][l];
        const struct attitude a = attitude_of(phi, theta, psi);
        const struct rates eta = kinematics(a, n);

        /* Controller. */
        real error[CHANNELS], sliding[CHANNELS], demand[CHANNELS];
        real attack = clip(n.w / larger(n.u, (real)0.02), (real)-0.3, (real)0.3);
        real turn = psi - plan->heading;
        error[DEPTH] = x[Z][l] - plan->depth;
        error[PITCH] = theta - plan->gliding_angle - attack;
        error[HEADING] = turn - 2 * PI * floor(turn * (1 / (2 * PI)) + (real)0.5);
        demand[DEPTH] = channel(law, plan->funnel, error[DEPTH],
                                eta.z - plan->depth_rate, block->integral[DEPTH][l],
                                sliding);
        demand[PITCH] = channel(law + PITCH, plan->funnel + PITCH, error[PITCH],
                                eta.theta, block->integral[PITCH][l], sliding + PITCH);
        demand[HEADING] = channel(law + HEADING, plan->funnel + HEADING, error[HEADING],
                                  eta.psi, block->integral[HEADING][l],
                                  sliding + HEADING);
        struct velocity drift = drifting(design, n);
        struct velocity seen = {drift.u + design->u_1 * block->disturbance[0][l],
                                drift.v + design->v_1 * block->disturbance[1][l],
                                drift.w + design->w_1 * block->disturbance[2][l],
                                0,
                                drift.q + design->q_1 * block->disturbance[4][l] -
                                    design->arm * design->q_1 * a.st,
                                drift.r + design->r_1 * block->disturbance[5][l]};
        real below = a.sp * n.v + a.cp * n.w, across = a.cp * n.v - a.sp * n.w;
        real spq = a.sp * n.q + a.cp * n.r, secant = 1 / a.ct;
        real r0 = -demand[DEPTH] - a.ct * (eta.phi * across - eta.theta * n.u) +
                  a.st * eta.theta * below -
                  a.ct * (a.sp * seen.v + a.cp * seen.w) + a.st * seen.u;
        real r1 = -demand[PITCH] + eta.phi * spq - a.cp * seen.q + a.sp * seen.r;
        real r2 = -demand[HEADING] -
                  secant * (eta.theta * (eta.phi + a.st * eta.psi) + a.sp * seen.q +
                            a.cp * seen.r);

        /* g and its damped inverse. */
        real held = block->held[HEADING][l], held2 = held * held;
        real sine = 1 + held2 * (held2 * (real)(1.0 / 120) - (real)(1.0 / 6));
        real cosine = held * (held2 * (real)(1.0 / 24) - (real)0.5);
        real g00 = design->gravity * (a.side * a.side * design->v_1 +
                                      a.down * a.down * design->w_1 +
                                      a.st * a.st * design->u_1);
        real g11 = -design->weight * (a.cp * a.down * design->q_1 +
                                      a.sp * a.side * design->r_1);
        real g21 = design->weight * a.sp * a.cp * (design->r_1 - design->q_1);
        real ratio = design->buoyancy / design->weight, g10 = ratio * g11;
        real g20 = ratio * g21, arm = design->arm * a.st;
        real g12 = -arm * (a.cp * cosine * design->q_1 + a.sp * sine * design->r_1);
        real g22 = arm * secant *
                   (a.cp * sine * design->r_1 - a.sp * cosine * design->q_1);
        real a00 = g00 * g00 + g10 * g10 + g20 * g20 + all->damping[0];
        real a11 = g11 * g11 + g21 * g21 + all->damping[1];
        real a22 = g12 * g12 + g22 * g22 + all->damping[2];
        real a01 = g10 * g11 + g20 * g21, a02 = g10 * g12 + g20 * g22;
        real a12 = g11 * g12 + g21 * g22;
        real b0 = g00 * r0 + g10 * r1 + g20 * r2, b1 = g11 * r1 + g21 * r2;
        real b2 = g12 * r1 + g22 * r2;
        real c00 = a11 * a22 - a12 * a12, c01 = a12 * a02 - a01 * a22;
        real c02 = a01 * a12 - a11 * a02, c11 = a00 * a22 - a02 * a02;
        real c12 = a01 * a02 - a00 * a12, c22 = a00 * a11 - a01 * a01;
        real once = 1 / (a00 * c00 + a01 * c01 + a02 * c02);
        const real wanted[CHANNELS] = {(c00 * b0 + c01 * b1 + c02 * b2) * once,
                                       (c01 * b0 + c11 * b1 + c12 * b2) * once,
                                       (c02 * b0 + c12 * b1 + c22 * b2) * once};
        const real applied[CHANNELS] = {
            clip(wanted[0], -law[0].limit, law[0].limit),
            clip(wanted[1], -law[1].limit, law[1].limit),
            clip(wanted[2], -law[2].limit, law[2].limit)};

        /* Running sums. */
#pragma GCC unroll 3
        for (int c = 0; c < CHANNELS; c++) {
            real(*sum)[LANES] = sums + c * SUMS;
            real e = error[c], size = fabs(e), u = applied[c], short_of = wanted[c] - u;
            real change = u - block->held[c][l], short2 = short_of * short_of;
            real edge = plan->funnel[c].inverse;
            real near = larger(e * edge * law[c].over_upper, e * edge * law[c].over_lower);
            real crowd = clip(5 * near - 4, 0, (real)1e3);
            real crowd4 = crowd * crowd * crowd * crowd;
            sum[ERROR2][l] += e * e;
            sum[EFFORT2][l] += u * u;
            sum[CHANGE2][l] += change * change;
            sum[MAX_ERROR][l] = larger(sum[MAX_ERROR][l], size);
            sum[MAX_SETTLED][l] =
                larger(sum[MAX_SETTLED][l], size * plan->funnel[c].settled);
            sum[OUTSIDE][l] += near > 1 ? (real)1 : (real)0;
            sum[SATURATED][l] += short_of != 0 ? (real)1 : (real)0;
            sum[CROWDING][l] += crowd4 / (1 + crowd4);
            sum[EXCESS][l] += short2 / (u * u + short2 + (real)1e-12);
            block->integral[c][l] += dt * sliding[c];
            block->held[c][l] = u;
        }
        sums[CHANNELS * SUMS][l] = larger(sums[CHANNELS * SUMS][l], fabs(phi));
        sums[CHANNELS * SUMS + 1][l] = larger(sums[CHANNELS * SUMS + 1][l], fabs(theta));

        /* Plant: four stages, the command held. */
        struct push push = pushed(&true_one, applied[0], applied[1], applied[2]);
        struct velocity at = n, dn = {0}, now = {0};
        struct attitude facing_now = a;
        struct rates dx = {0}, rate = {0};
#pragma GCC unroll 4
        for (int stage = 0; stage < 4; stage++) {
            const real *tau = plan->force[(stage + 1) / 2];
            if (stage > 0) {
                real h = stage < 3 ? (real)0.5 * dt : dt;
                struct rates d = {0, 0, 0, h * rate.phi, h * rate.theta, h * rate.psi};
                at = (struct velocity){n.u + h * now.u, n.v + h * now.v, n.w + h * now.w,
                                       n.p + h * now.p, n.q + h * now.q, n.r + h * now.r};
                facing_now = TURNED(a, phi, theta, psi, d);
            }
            now = pushing(drifting(&true_one, at), push, facing_now);
            now.u += true_one.u_1 * tau[0];
            now.v += true_one.v_1 * tau[1];
            now.w += true_one.w_1 * tau[2];
            now.p += true_one.p_1 * tau[3];
            now.q += true_one.q_1 * tau[4];
            now.r += true_one.r_1 * tau[5];
            rate = kinematics(facing_now, at);
            real weight = stage == 0 || stage == 3 ? 1 : 2;
            dn = (struct velocity){dn.u + weight * now.u, dn.v + weight * now.v,
                                   dn.w + weight * now.w, dn.p + weight * now.p,
                                   dn.q + weight * now.q, dn.r + weight * now.r};
            dx = (struct rates){dx.x + weight * rate.x, dx.y + weight * rate.y,
                                dx.z + weight * rate.z, dx.phi + weight * rate.phi,
                                dx.theta + weight * rate.theta, dx.psi + weight * rate.psi};
        }
        const real sixth = dt * (real)(1.0 / 6);
        x[X][l] += sixth * dx.x;
        x[Y][l] += sixth * dx.y;
        x[Z][l] += sixth * dx.z;
        x[PHI][l] = phi + sixth * dx.phi;
        x[THETA][l] = theta + sixth * dx.theta;
        x[PSI][l] = psi + sixth * dx.psi;

        /* Observer. */
        struct push belief = pushed(design, applied[0], applied[1], applied[2]);
        struct velocity hoped = pushing(drift, belief, a);
        const real expected[AXES] = {hoped.u, hoped.v, hoped.w, hoped.p, hoped.q, hoped.r};
        const real following[AXES] = {n.u + sixth * dn.u, n.v + sixth * dn.v,
                                      n.w + sixth * dn.w, n.p + sixth * dn.p,
                                      n.q + sixth * dn.q, n.r + sixth * dn.r};
#pragma GCC unroll 6
        for (int i = 0; i < AXES; i++) {
            const struct observer_gains *g = gains + i;
            real m = inertia[i], d = block->disturbance[i][l];
            real target = m * (following[i] - block->expected[i][l] - dt * expected[i]) - dt * d;
            real y = observer_root(g, target), q2 = y * y + g->smoothing2;
            real iq = 1 / sqrt(q2), q = q2 * iq;
            block->disturbance[i][l] =
                d + g->over_dt * y * (g->near2 * iq + (g->constant - 1) + g->far2 * q);
            block->expected[i][l] = following[i] - y * g->inverse_inertia;
            x[U + i][l] = following[i];
        }
    }
}

static struct funnel funnel_at(const struct shared *all, int c, real clock)
{
    real slope = 1 / cosh(all->initial[c]), duration = all->settling_time[c];
    real limit = larger(40 / slope, 1);
    int falling = clock < duration * (1 - 1 / limit);
    real z = duration / (duration - (falling ? clock : 0)), z1 = z * z / duration;
    real z2 = 2 * z * z1 / duration, decay = exp(-slope * z);
    real sech = 2 * decay / (1 + decay * decay);
    real tanh_ = (1 - decay * decay) / (1 + decay * decay);
    real y1 = slope * z1, y2 = slope * z2, live = falling ? 1 : 0;
    real width = live * sech + all->final_bound[c];
    return (struct funnel){width, 1 / width, -live * sech * tanh_ * y1,
                           live * sech * ((tanh_ * tanh_ - sech * sech) * y1 * y1 -
                                          tanh_ * y2),
                           clock >= duration ? 1 : 0};
}

/* Everything that depends on time alone, for all ticks. */
static void make_plan(struct plan *plan, const struct shared *all,
                      const struct schedule *task, const real *sea, int64_t ticks)
{
    real begun = 0;
    int64_t segment = 0;
    for (int64_t k = 0; k < ticks; k++) {
        struct plan *p = plan + k;
        real time = (real)k * all->dt;
        while (segment + 1 < task->segments && time >= task->start[segment + 1]) {
            begun += task->depth_rate[segment] *
                     (task->start[segment + 1] - task->start[segment]);
            segment++;
        }
        real clock = time - task->start[segment];
        p->depth_rate = task->depth_rate[segment];
        p->depth = begun + p->depth_rate * clock;
        p->gliding_angle = task->gliding_angle[segment];
        p->heading = task->heading[segment];
        for (int c = 0; c < CHANNELS; c++)
            p->funnel[c] = funnel_at(all, c, clock);
        for (int i = 0; i < AXES; i++) {
            const real *tau = sea + i * (ticks + 1) + k;
            p->force[0][i] = tau[0];
            p->force[1][i] = (real)0.5 * (tau[0] + tau[1]);
            p->force[2][i] = tau[1];
        }
    }
}

static void make_laws(struct law *law, struct observer_gains *gains, const struct shared *all)
{
    for (int c = 0; c < CHANNELS; c++) {
        real rho = all->rho[c], over = 4 - 3 * rho, half = (real)0.5;
        law[c] = (struct law){
            all->k1[c], all->k2[c], all->k1[c] + all->k2[c],
            half * (rho / (2 - rho) - 1), half * (rho - 1),
            half * (over / (2 - rho) - 1), half * (over / (3 - 2 * rho) - 1),
            half / all->mu[c], all->smoothing * all->smoothing,
            all->lower[c], all->upper[c], -all->tail[c] * all->lower[c],
            all->tail[c] * all->upper[c], 2 / (all->lower[c] + all->upper[c]),
            1 / all->upper[c], -1 / all->lower[c], all->limit[c]};
    }
    for (int i = 0; i < AXES; i++) {
        real a1 = all->dt * all->proportional[i], s = all->stretch[i];
        real a2 = all->dt * all->dt * all->integral[i], delta = all->observer_smoothing;
        real bend = delta + (real)0.5 * a2;
        gains[i] = (struct observer_gains){
            1 + 2 * a2 * s, a1, a1 * s, (real)0.5 * a2, (real)1.5 * a2 * s * s,
            delta * delta, bend * bend, 1 / all->dt, 1 / all->design[INERTIA + i]};
    }
}

static void fly(const struct shared *all, const struct vehicle *design,
                const struct law *law, const struct observer_gains *gains,
                const struct plan *plan, int64_t ticks, int64_t members, int64_t first,
                const real *parameters, real *metrics)
{
    struct block block;
    memset(&block, 0, sizeof block);
    for (int l = 0; l < LANES; l++) {
        int64_t member = first + l < members ? first + l : members - 1;
        real own[PARAMETERS];
        for (int i = 0; i < PARAMETERS; i++)
            own[i] = parameters[i * members + member];
        struct vehicles *lanes = &block.vehicles;
        struct vehicle one = normalised(own);
        COEFFICIENTS(TO_LANE)
        for (int i = 0; i < STATES; i++)
            block.state[i][l] = all->start[i];
        for (int i = 0; i < AXES; i++)
            block.expected[i][l] = all->start[U + i];
    }
    for (int64_t k = 0; k < ticks; k++) {
        tick(&block, design, law, gains, all, plan + k);
        if (k == 0) /* chattering counts from the second command on */
            for (int c = 0; c < CHANNELS; c++)
                memset(block.sums[c * SUMS + CHANGE2], 0, sizeof block.sums[0]);
    }
    for (int l = 0; l < LANES && first + l < members; l++) {
        real *result = metrics + first + l, all_finite = 1;
        for (int i = 0; i < METRICS - 1; i++) {
            int kind = i < CHANNELS * SUMS ? i % SUMS : MAX_ERROR;
            real sum = block.sums[i][l], mean = sum / (real)ticks;
            result[i * members] = kind <= CHANGE2 ? sqrt(mean)
                                : kind <= MAX_SETTLED ? sum : mean;
            all_finite *= is_finite(sum);
        }
        for (int i = 0; i < STATES; i++)
            all_finite *= is_finite(block.state[i][l]);
        result[(METRICS - 1) * members] = all_finite;
    }
}

/* Metrics of all members, one row for each; 0, or 1 where there is no memory. */
int evaluate(const struct shared *all, const struct schedule *task, const real *sea,
             const real *parameters, int64_t members, int64_t ticks, int threads,
             real *metrics)
{
    struct plan *plan = malloc(sizeof(struct plan) * (size_t)ticks);
    if (!plan)
        return 1;
    struct law law[CHANNELS];
    struct observer_gains gains[AXES];
    const struct vehicle design = normalised(all->design);
    make_plan(plan, all, task, sea, ticks);
    make_laws(law, gains, all);
#pragma omp parallel for num_threads(threads) schedule(dynamic)
    for (int64_t first = 0; first < members; first += LANES)
        fly(all, &design, law, gains, plan, ticks, members, first, parameters, metrics);
    free(plan);
    return 0;
}
