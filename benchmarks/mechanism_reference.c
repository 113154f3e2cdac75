/* The integrator of sim_backend/rigd_sim/mechanism/kernel.py in plain C: the same scheme, step
 * by step, as the yardstick of its speed. layout.h is written by mechanism.py from the same records. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "layout.h"

#define GAMMA 0.57282
#define A21 2.0
#define A31 1.867943637803922
#define A32 0.2344449711399156
#define C21 -7.137615036412310
#define C31 2.580708087951457
#define C32 0.6515950076447975
#define C41 -2.137148994382534
#define C42 -0.3214669691237626
#define C43 -0.6949742501781779
#define M1 2.255570073418735
#define M2 0.2870493262186792
#define M3 0.4353179431840180
#define M4 1.093502252409163

enum { SPRING, CONSTANT, PENDULUM, STOP, SLIDING, BRISTLES, CURRENT, SPEED, POSITION };
enum { AT_POSITION, AT_SPEED, AT_FORCE, AT_LOAD, AT_TEMPERATURE };

static double limited(double value, double limit)
{
    return fmin(fmax(value, -limit), limit);
}

static double fall(const element *el, double v, double *bend)
{
    double excess = el->f_s - el->f_c;
    *bend = 0.0;
    if (excess == 0.0)
        return el->f_c;
    double ratio = fabs(v) / el->v_s;
    double power = el->shape == 2.0 ? ratio * ratio : el->shape == 1.0 ? ratio : pow(ratio, el->shape);
    double part = excess * exp(-power);
    *bend = -el->shape * power * part;
    return el->f_c + part;
}

static void sliding(const element *el, double v, double load, term *out)
{
    double pushed = el->visc * v, slope = el->visc;
    if (el->f_s > 0.0) {
        double bend, g = fall(el, v, &bend), sign = tanh(v / el->smooth);
        pushed += g * sign;
        slope += g * (1.0 - sign * sign) / el->smooth;
        if (v != 0.0)
            slope += bend * sign / v;
    }
    out->pushed = pushed;
    out->f = load * pushed;
    out->f_v = load * slope;
    out->power = out->f * v;
}

static void bristles(const element *el, double v, double z, double load, term *out)
{
    double bend, g = fall(el, v, &bend), speed = fabs(v);
    double sign = v > 0.0 ? 1.0 : v < 0.0 ? -1.0 : 0.0;
    double back = el->s_0 * z / g, rate = v - speed * back;
    out->g = rate;
    out->g_v = 1.0 - sign * back * (1.0 - bend / g);
    out->g_z = -el->s_0 * speed / g;
    out->pushed = el->s_0 * z + el->s_1 * rate + el->visc * v;
    out->f = load * out->pushed;
    out->f_v = load * (el->s_1 * out->g_v + el->visc);
    out->f_z = load * (el->s_0 + el->s_1 * out->g_z);
    out->power = out->f * v - load * el->s_0 * z * rate;
    out->stored = 0.5 * load * el->s_0 * z * z;
}

static void spring(const element *el, double e, double v, term *out)
{
    double stretch = e;
    if (el->play > 0.0) {
        stretch = e - limited(e, el->play);
        if (stretch == 0.0)
            return;
    }
    double force = el->k * stretch + el->d * v;
    out->stored = 0.5 * el->k * stretch * stretch;
    if (el->play > 0.0 && force * stretch < 0.0) {
        out->power = -el->k * stretch * v;
        return;
    }
    out->f = force;
    out->f_e = el->k;
    out->f_v = el->d;
    out->power = el->d * v * v;
}

static void stop(const element *el, double e, double v, term *out)
{
    double pressed = e - fmin(fmax(e, el->low), el->high);
    if (pressed == 0.0)
        return;
    double force = el->k * pressed + el->d * v;
    out->stored = 0.5 * el->k * pressed * pressed;
    if (force * pressed < 0.0) {
        out->power = -el->k * pressed * v;
        return;
    }
    out->f = force;
    out->f_e = el->k;
    out->f_v = el->d;
    out->power = el->d * v * v;
}

static void current(const element *el, double v, double z, double command, double on, term *out)
{
    double goal = on > 0.5 ? limited(command, el->limit) : 0.0, slope = 0.0;
    if (el->supply > 0.0) {
        double emf = el->k * v;
        double high = (el->supply - emf) / el->resistance, low = (-el->supply - emf) / el->resistance;
        if (goal > high || goal < low) {
            goal = goal > high ? high : low;
            slope = -el->k / el->resistance;
        }
    }
    out->f = -el->k * z;
    out->f_z = -el->k;
    out->g = el->rate * (goal - z);
    out->g_v = el->rate * slope;
    out->g_z = -el->rate;
}

static void servo(const element *el, double e, double v, double z, double command, double on,
                  term *out)
{
    if (on < 0.5)
        return;
    double target = command, outer = 0.0;
    if (el->kind == POSITION) {
        target = el->outer * (command - e);
        outer = el->outer;
    }
    if (fabs(target) > el->fastest) {
        target = limited(target, el->fastest);
        outer = 0.0;
    }
    double error = target - v, force = el->d * error + el->k * z;
    if (fabs(force) <= el->limit) {
        out->f = -force;
        out->f_v = el->d;
        out->f_e = el->d * outer;
        out->f_z = -el->k;
    } else {
        force = limited(force, el->limit);
        out->f = -force;
        if (error * force > 0.0)
            return;
    }
    out->g = error;
    out->g_v = -1.0;
    out->g_e = -outer;
}

static void evaluate(const element *els, long count, const double *commands, const double *y,
                     long bodies, term *terms)
{
    long speeds = bodies + 1, inner = 2 * bodies + 2;
    for (long n = 0; n < count; n++) {
        const element *el = els + n;
        term *out = terms + n;
        long i = (long)el->i, j = (long)el->j;
        double e = el->a * y[i] + el->b * y[j] + el->offset;
        double v = el->a * y[speeds + i] + el->b * y[speeds + j];
        double z = y[inner + n], load = el->load;
        memset(out, 0, offsetof(term, way_f));
        if (el->press >= 0.0) {
            const term *by = terms + (long)el->press;
            load = 0.0;
            if (by->f < 0.0) {
                load = -by->f;
                out->press_e = -by->f_e;
                out->press_v = -by->f_v;
            }
        }
        const double *command = commands + 2 * (el->command < 0.0 ? 0 : (long)el->command);
        switch ((int)el->kind) {
        case SPRING: spring(el, e, v, out); break;
        case SLIDING: sliding(el, v, load, out); break;
        case BRISTLES: bristles(el, v, z, load, out); break;
        case CURRENT: current(el, v, z, command[0], command[1], out); break;
        case SPEED:
        case POSITION: servo(el, e, v, z, command[0], command[1], out); break;
        case STOP: stop(el, e, v, out); break;
        case PENDULUM:
            out->f = el->k * sin(e);
            out->f_e = el->k * cos(e);
            out->stored = el->k * (1.0 - cos(e));
            break;
        default: out->f = el->k; out->stored = el->k * e;
        }
    }
}

static void factorise(const double *masses, const element *els, long count, term *terms, long bodies,
                      double s, double *matrix)
{
    double brief = 1.0 / s;
    for (long i = 0; i < bodies; i++) {
        for (long j = 0; j < bodies; j++)
            matrix[i * bodies + j] = 0.0;
        matrix[i * bodies + i] = s * masses[i];
    }
    for (long n = 0; n < count; n++) {
        const element *el = els + n;
        term *t = terms + n;
        long i = (long)el->i, j = (long)el->j;
        double value = t->f_e * brief + t->f_v;
        t->way_f = t->f_e * brief;
        if (el->kind >= BRISTLES) {
            t->settled = 1.0 / (s - t->g_z);
            t->z_f = t->f_z * t->settled;
            t->way_f += t->z_f * t->g_e * brief;
            value += t->z_f * (t->g_e * brief + t->g_v);
        }
        if (value != 0.0) {
            matrix[i * bodies + i] += value * el->a * el->a;
            if (j < bodies) {
                matrix[i * bodies + j] += value * el->a * el->b;
                matrix[j * bodies + i] += value * el->a * el->b;
                matrix[j * bodies + j] += value * el->b * el->b;
            }
        }
        if (el->press >= 0.0) {
            const element *by = els + (long)el->press;
            long p = (long)by->i, q = (long)by->j;
            value = t->pushed * (t->press_e * brief + t->press_v);
            matrix[i * bodies + p] += value * el->a * by->a;
            if (q < bodies)
                matrix[i * bodies + q] += value * el->a * by->b;
            if (j < bodies) {
                matrix[j * bodies + p] += value * el->b * by->a;
                if (q < bodies)
                    matrix[j * bodies + q] += value * el->b * by->b;
            }
        }
    }
    for (long k = 0; k < bodies; k++) {
        matrix[k * bodies + k] = 1.0 / matrix[k * bodies + k];
        for (long i = k + 1; i < bodies; i++)
            if (matrix[i * bodies + k] != 0.0) {
                double factor = matrix[i * bodies + k] * matrix[k * bodies + k];
                matrix[i * bodies + k] = factor;
                for (long j = k + 1; j < bodies; j++)
                    matrix[i * bodies + j] -= factor * matrix[k * bodies + j];
            }
    }
}

static void solve(const element *els, long count, const term *terms, long bodies, double s,
                  const double *matrix, double *u)
{
    long speeds = bodies + 1, inner = 2 * bodies + 2;
    double brief = 1.0 / s;
    for (long n = 0; n < count; n++) {
        const element *el = els + n;
        const term *t = terms + n;
        long i = (long)el->i, j = (long)el->j;
        double force = t->way_f * (el->a * u[i] + el->b * u[j]);
        if (el->kind >= BRISTLES)
            force += t->z_f * u[inner + n];
        if (el->press >= 0.0) {
            const element *by = els + (long)el->press;
            double way = by->a * u[(long)by->i] + by->b * u[(long)by->j];
            force += t->pushed * t->press_e * way / s;
        }
        u[speeds + i] -= el->a * force;
        if (j < bodies)
            u[speeds + j] -= el->b * force;
    }
    for (long i = 1; i < bodies; i++)
        for (long k = 0; k < i; k++)
            u[speeds + i] -= matrix[i * bodies + k] * u[speeds + k];
    for (long i = bodies - 1; i >= 0; i--) {
        for (long k = i + 1; k < bodies; k++)
            u[speeds + i] -= matrix[i * bodies + k] * u[speeds + k];
        u[speeds + i] *= matrix[i * bodies + i];
    }
    for (long i = 0; i < bodies; i++)
        u[i] = (u[i] + u[speeds + i]) * brief;
    for (long n = 0; n < count; n++) {
        const element *el = els + n;
        if (el->kind >= BRISTLES) {
            const term *t = terms + n;
            long i = (long)el->i, j = (long)el->j;
            double way = el->a * u[i] + el->b * u[j];
            double speed = el->a * u[speeds + i] + el->b * u[speeds + j];
            u[inner + n] = (u[inner + n] + t->g_e * way + t->g_v * speed) * t->settled;
        }
    }
}

static void rates(const element *els, long count, const term *terms, const double *y, long bodies,
                  double *u)
{
    long speeds = bodies + 1, inner = 2 * bodies + 2;
    for (long i = 0; i < bodies; i++) {
        u[i] = y[speeds + i];
        u[speeds + i] = 0.0;
    }
    u[bodies] = u[speeds + bodies] = 0.0;
    for (long n = 0; n < count; n++) {
        const element *el = els + n;
        long i = (long)el->i, j = (long)el->j;
        u[speeds + i] -= el->a * terms[n].f;
        if (j < bodies)
            u[speeds + j] -= el->b * terms[n].f;
        u[inner + n] = terms[n].g;
    }
}

static void add(double *u, const double *other, const double *masses, long bodies, long size)
{
    long speeds = bodies + 1;
    for (long i = 0; i < bodies; i++) {
        u[i] += other[i];
        u[speeds + i] += masses[i] * other[speeds + i];
    }
    for (long i = 2 * bodies + 2; i < size; i++)
        u[i] += other[i];
}

static void step(const double *masses, const element *els, long count, const double *commands,
                 double *y, term *terms, term *again, double *work, long wide, long bodies, double h)
{
    long size = 2 * bodies + 2 + count;
    double *u1 = work, *u2 = work + wide, *u3 = work + 2 * wide, *u4 = work + 3 * wide;
    double *between = work + 4 * wide, *matrix = work + 5 * wide, s = 1.0 / (GAMMA * h);
    factorise(masses, els, count, terms, bodies, s, matrix);

    rates(els, count, terms, y, bodies, u1);
    solve(els, count, terms, bodies, s, matrix, u1);

    for (long k = 0; k < size; k++)
        between[k] = y[k] + A21 * u1[k];
    evaluate(els, count, commands, between, bodies, again);
    rates(els, count, again, between, bodies, u2);
    for (long k = 0; k < size; k++)
        between[k] = C21 / h * u1[k];
    add(u2, between, masses, bodies, size);
    solve(els, count, terms, bodies, s, matrix, u2);

    for (long k = 0; k < size; k++)
        between[k] = y[k] + A31 * u1[k] + A32 * u2[k];
    evaluate(els, count, commands, between, bodies, again);
    rates(els, count, again, between, bodies, u3);
    for (long k = 0; k < size; k++) {
        u4[k] = u3[k];
        between[k] = C31 / h * u1[k] + C32 / h * u2[k];
    }
    add(u3, between, masses, bodies, size);
    solve(els, count, terms, bodies, s, matrix, u3);

    for (long k = 0; k < size; k++)
        between[k] = C41 / h * u1[k] + C42 / h * u2[k] + C43 / h * u3[k];
    add(u4, between, masses, bodies, size);
    solve(els, count, terms, bodies, s, matrix, u4);

    for (long k = 0; k < size; k++)
        y[k] += M1 * u1[k] + M2 * u2[k] + M3 * u3[k] + M4 * u4[k];
    for (long n = 0; n < count; n++)
        if (els[n].kind == BRISTLES)
            y[2 * bodies + 2 + n] = limited(y[2 * bodies + 2 + n], els[n].f_s / els[n].s_0);
}

static double measured(const sensor *item, const element *els, const term *terms,
                       const filter *filters, long sensors, const double *y, long bodies)
{
    long index = (long)item->index;
    double value;
    switch ((int)item->measure) {
    case AT_POSITION: value = item->lever * y[index] + item->offset; break;
    case AT_SPEED: value = item->lever * y[bodies + 1 + index]; break;
    case AT_FORCE: value = terms[index].f; break;
    case AT_LOAD:
        value = els[index].press < 0.0 ? els[index].load : fmax(0.0, -terms[(long)els[index].press].f);
        break;
    case AT_TEMPERATURE: value = filters[sensors + index].out; break;
    default: value = y[2 * bodies + 2 + index];
    }
    return item->factor * value;
}

static void prepare(filter *row, double rate, double h)
{
    row->keep = row->slope = 0.0;
    if (rate > 0.0 && h > 0.0) {
        row->keep = exp(-rate * h);
        row->slope = (1.0 - row->keep) / (rate * h);
    }
}

static void follow(filter *row, double value)
{
    row->out = value + (row->out - row->last) * row->keep - (value - row->last) * row->slope;
    row->last = value;
}

static void look(const element *els, long count, const sensor *items, long sensors, const warm *parts,
                 long warms, const double *heat, double ambient, const double *y, const term *terms,
                 filter *filters, long bodies, int first, int begun)
{
    for (long k = 0; k < warms; k++) {
        double power = 0.0;
        for (long n = 0; n < count; n++)
            if (heat[k * count + n] != 0.0)
                power += heat[k * count + n] * terms[n].power;
        filter *row = filters + sensors + k;
        double value = ambient + parts[k].rise * power;
        if (!begun)
            row->out = ambient;
        if (first)
            row->last = value;
        else
            follow(row, value);
    }
    for (long k = 0; k < sensors; k++) {
        filter *row = filters + k;
        double value = measured(items + k, els, terms, filters, sensors, y, bodies);
        if (items[k].rate == 0.0 || !begun)
            row->out = value;
        if (first)
            row->last = value;
        else if (items[k].rate > 0.0)
            follow(row, value);
    }
}

void integrate(const double *masses, const element *els, const sensor *items, const warm *parts,
               const double *heat, double ambient, const double *commands, double *y, term *terms,
               term *again, double *work, filter *filters, tally *now, double h, long steps,
               long bodies, long count, long sensors, long warms, long wide)
{
    for (long n = 0; n < count; n++)
        if (els[n].kind >= SPEED && commands[2 * (long)els[n].command + 1] < 0.5)
            y[2 * bodies + 2 + n] = 0.0;
    for (long k = 0; k < sensors; k++)
        prepare(filters + k, items[k].rate, h);
    for (long k = 0; k < warms; k++)
        prepare(filters + sensors + k, parts[k].rate, h);
    for (long n = 0; n <= steps; n++) {
        evaluate(els, count, commands, y, bodies, terms);
        look(els, count, items, sensors, parts, warms, heat, ambient, y, terms, filters, bodies,
             n == 0, now->begun > 0.5);
        now->begun = 1.0;
        if (n < steps)
            step(masses, els, count, commands, y, terms, again, work, wide, bodies, h);
    }
}
