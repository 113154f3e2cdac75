/* The integrator of sim_backend/rigd_sim/articulated/kernel.py in plain C: the same scheme,
 * step by step, with loads that do not change, as the yardstick of its speed. layout.h is written by
 * articulated.py from the same records. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "layout.h"

enum { COS, SIN, FX, FY, MOMENT, AT, AT_COS, AT_SIN, ROW };
enum { LEGS = 6 };
static const double BEYOND = 1e-9, TOGETHER = 1e-11, LOCATED = 1e-12;

typedef struct {
    const constants *c;
    const module *modules;
    const spin *spins;
    const double *beta, *gram;
    const int64_t *wheel_spin;
    long n, m;
} robot;

static double sign_of(double ratio)
{
    return ratio > 20.0 ? 1.0 : ratio < -20.0 ? -1.0 : tanh(ratio);
}

static void turn(double *w, double heading)
{
    double angle = heading - w[AT], square = angle * angle;
    if (square > 4e-4) {
        w[COS] = cos(heading);
        w[SIN] = sin(heading);
        return;
    }
    double s = angle * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)));
    double c = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0));
    w[COS] = w[AT_COS] * c - w[AT_SIN] * s;
    w[SIN] = w[AT_SIN] * c + w[AT_COS] * s;
}

static double share(const constants *c, const module *p, double square, double load, bool slides)
{
    if (c->law == 0.0)
        return slides ? p->mu_d * load / sqrt(fmax(square, 1e-300)) : 1.0;
    if (c->law != 1.0)
        return 1.0;
    double limit = p->mu_s * load, low = (1.0 - c->width) * limit;
    if (square <= low * low)
        return 1.0;
    double force = sqrt(square), sliding = p->mu_d * load / force;
    if (force >= (1.0 + c->width) * limit)
        return sliding;
    double at = (force - low) / (2.0 * c->width * limit);
    return 1.0 + at * at * at * (10.0 - at * (15.0 - 6.0 * at)) * (sliding - 1.0);
}

static void evaluate(const robot *r, const double *commands, const double *y, double *dy,
                     const bool *slides, double *excess, double *torques, double *work)
{
    const constants *c = r->c;
    long n = r->n, m = r->m, moving = n + 2, turning = 2 * n + 4, width = ROW + n;
    long sums = turning + m, angles = turning + 2 * m, energy = turning + 3 * m;
    double supplied = 0.0, lost = 0.0;
    for (long j = 0; j < m; j++) {
        double speed = y[turning + j];
        dy[angles + j] = speed;
        torques[j] = dy[sums + j] = 0.0;
        if (r->spins[j].driven > 0.5 && commands[2 * j + 1] > 0.5) {
            const spin *s = &r->spins[j];
            double error = commands[2 * j] - s->ratio * speed;
            double demand = s->kp * error + s->ki * y[sums + j];
            dy[sums + j] = error;
            if (demand > s->torque_limit) {
                demand = s->torque_limit;
                dy[sums + j] = fmin(error, 0.0);
            } else if (demand < -s->torque_limit) {
                demand = -s->torque_limit;
                dy[sums + j] = fmax(error, 0.0);
            }
            torques[j] = demand;
        }
        dy[turning + j] = r->spins[j].ratio * torques[j];
        torques[m + j] = sign_of(speed / c->rest);
        supplied += dy[turning + j] * speed;
    }
    for (long i = 0; i < moving; i++)
        dy[i] = y[moving + i];
    for (long i = 0; i < n; i++)
        turn(work + i * width, y[2 + i]);

    double total_x = 0.0, total_y = 0.0;
    for (long i = 0; i < n; i++) {
        const module *p = &r->modules[i];
        double *w = work + i * width;
        double omega = y[moving + 2 + i], vx = y[moving], vy = y[moving + 1];
        for (long j = 0; j < n; j++) {
            double rim = r->beta[i * n + j] * y[moving + 2 + j];
            vx -= rim * work[j * width + SIN];
            vy += rim * work[j * width + COS];
        }
        double forward = w[COS] * vx + w[SIN] * vy, aside = w[COS] * vy - w[SIN] * vx;
        double along = 0.0, across = 0.0, moment = 0.0;
        for (long k = 0; k < 4; k++) {
            double front = k < 2 ? 1.0 : -1.0, left = k & 1 ? 1.0 : -1.0;
            long j = r->wheel_spin[4 * i + k];
            double turned = y[turning + j];
            double slip = p->r * turned - forward + left * p->b * omega;
            double eta = aside + front * p->d * omega;
            double f_lon = p->k_lon * slip, f_lat = -p->k_lat * eta;
            double square = f_lon * f_lon + f_lat * f_lat, limit = p->mu_s * p->load;
            excess[4 * i + k] = limit > 0.0 ? square / (limit * limit) - 1.0 : -1.0;
            if (slides[4 * i + k] || c->law == 1.0) {
                double scale = share(c, p, square, p->load, slides[4 * i + k]);
                f_lon *= scale;
                f_lat *= scale;
            }
            along += f_lon;
            across += f_lat;
            moment += front * p->d * f_lat - left * p->b * f_lon;
            double rolling = p->k_roll * p->load * torques[m + j];
            dy[turning + j] -= p->r * f_lon + rolling;
            lost += f_lon * slip - f_lat * eta + rolling * turned;
        }
        w[FX] = w[COS] * along - w[SIN] * across;
        w[FY] = w[SIN] * along + w[COS] * across;
        w[MOMENT] = moment;
        total_x += w[FX];
        total_y += w[FY];
    }
    for (long j = 0; j < m; j++)
        dy[turning + j] /= r->spins[j].inertia;
    dy[moving] = total_x / c->mass;
    dy[moving + 1] = total_y / c->mass;

    double *right = dy + moving + 2;
    for (long i = 0; i < n; i++) {
        double *w = work + i * width;
        double value = w[MOMENT];
        for (long j = 0; j < n; j++) {
            const double *o = work + j * width;
            double rate = y[moving + 2 + j];
            value += r->beta[j * n + i] * (w[COS] * o[FY] - w[SIN] * o[FX]);
            value -= r->gram[i * n + j] * (w[SIN] * o[COS] - w[COS] * o[SIN]) * rate * rate;
            w[ROW + j] = r->gram[i * n + j] * (w[COS] * o[COS] + w[SIN] * o[SIN]);
        }
        w[ROW + i] += r->modules[i].inertia;
        right[i] = value;
    }
    for (long i = 0; i + 1 < n; i++) {
        double rate = y[moving + 2 + i] - y[moving + 3 + i], angle = y[2 + i] - y[3 + i];
        double stop = 0.0, spring = 0.0;
        const module *b = &r->modules[i + 1];
        if (angle > b->stop) {
            spring = -b->stop_stiffness * (angle - b->stop);
            stop = -fmax(0.0, -spring * (1.0 + b->stop_damping * rate));
        } else if (angle < -b->stop) {
            spring = b->stop_stiffness * (-b->stop - angle);
            stop = fmax(0.0, spring * (1.0 - b->stop_damping * rate));
        }
        right[i] += stop;
        right[i + 1] -= stop;
        lost += (spring - stop) * rate;
    }
    for (long i = 0; i < n; i++) {
        double pivot = 1.0 / work[i * width + ROW + i];
        for (long j = i + 1; j < n; j++) {
            double factor = work[i * width + ROW + j] * pivot;
            for (long k = j; k < n; k++)
                work[j * width + ROW + k] -= factor * work[i * width + ROW + k];
            right[j] -= factor * right[i];
        }
    }
    for (long i = n - 1; i >= 0; i--) {
        double value = right[i];
        for (long j = i + 1; j < n; j++)
            value -= work[i * width + ROW + j] * right[j];
        right[i] = value / work[i * width + ROW + i];
    }
    dy[energy] = supplied;
    dy[energy + 1] = lost;
}

static void refer(double *work, const double *y, long n, bool exactly)
{
    for (long i = 0; i < n; i++) {
        double *w = work + i * (ROW + n);
        w[AT_COS] = exactly ? cos(y[2 + i]) : w[COS];
        w[AT_SIN] = exactly ? sin(y[2 + i]) : w[SIN];
        w[AT] = y[2 + i];
    }
}

static double farthest(const bool *slides, const double *excess, long wheels)
{
    double worst = -1.0;
    for (long k = 0; k < wheels; k++)
        worst = fmax(worst, slides[k] ? -excess[k] : excess[k]);
    return worst;
}

static void sort_branches(bool *slides, const double *excess, long wheels, double least)
{
    for (long k = 0; k < wheels; k++)
        if ((slides[k] ? -excess[k] : excess[k]) > least)
            slides[k] = !slides[k];
}

static void runge_kutta(const robot *r, const double *commands, const double *state, double h,
                        long active, long size, const bool *slides, double *rates, double *excess,
                        double *torques, double *work)
{
    double *k1 = rates, *k2 = k1 + size, *k3 = k2 + size, *k4 = k3 + size;
    double *y = k4 + size, *tried = y + size, half = 0.5 * h, sixth = h / 6.0;
    for (long i = 0; i < active; i++)
        y[i] = state[i] + half * k1[i];
    evaluate(r, commands, y, k2, slides, excess, torques, work);
    for (long i = 0; i < active; i++)
        y[i] = state[i] + half * k2[i];
    evaluate(r, commands, y, k3, slides, excess, torques, work);
    for (long i = 0; i < active; i++)
        y[i] = state[i] + h * k3[i];
    evaluate(r, commands, y, k4, slides, excess, torques, work);
    for (long i = 0; i < active; i++)
        tried[i] = state[i] + sixth * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
    evaluate(r, commands, tried, tried + size, slides, excess, torques, work);
}

void integrate(const constants *c, const module *modules, const spin *spins, const double *beta,
               const double *gram, const int64_t *wheel_spin, const double *commands, double *state,
               bool *slides, double *scratch, double step, long steps, long n, long m, long size)
{
    robot r = {c, modules, spins, beta, gram, wheel_spin, n, m};
    long active = size - LEGS * n, wheels = 4 * n;
    double *rates = scratch, *work = rates + 7 * size;
    double *torques = work + n * (ROW + n), *excess = torques + 2 * m;
    bool paper = c->law == 0.0;
    for (long j = 0; j < m; j++)
        if (commands[2 * j + 1] < 0.5)
            state[2 * n + 4 + m + j] = 0.0;
    refer(work, state, n, true);
    evaluate(&r, commands, state, rates, slides, excess, torques, work);
    if (paper && farthest(slides, excess, wheels) > BEYOND) {
        sort_branches(slides, excess, wheels, BEYOND);
        evaluate(&r, commands, state, rates, slides, excess, torques, work);
    }
    for (long number = 0; number < steps; number++) {
        double rest = step;
        int events = 0;
        while (rest > 0.0) {
            double h = rest, low = 0.0, high = rest;
            bool searching = false;
            refer(work, state, n, number % 64 == 0);
            for (;;) {
                runge_kutta(&r, commands, state, h, active, size, slides, rates, excess, torques,
                            work);
                if (!paper || events >= 32)
                    break;
                double beyond = farthest(slides, excess, wheels);
                if (!searching) {
                    if (beyond <= BEYOND)
                        break;
                    searching = true;
                } else if (fabs(beyond) <= LOCATED || high - low <= 1e-14 * step) {
                    break;
                } else if (beyond > 0.0) {
                    high = h;
                } else {
                    low = h;
                }
                h = 0.5 * (low + high);
            }
            memcpy(state, rates + 5 * size, (size_t)active * sizeof *state);
            memcpy(rates, rates + 6 * size, (size_t)active * sizeof *state);
            rest -= h;
            if (searching) {
                sort_branches(slides, excess, wheels, -TOGETHER);
                events++;
                evaluate(&r, commands, state, rates, slides, excess, torques, work);
            }
        }
    }
}
