/* The integrator of sim_backend/rigd_sim/lugre/kernel.py in plain C: the same scheme, step
 * by step, as the yardstick of its speed. layout.h is written by plant.py from the same records. */
#include <math.h>

#include "layout.h"

typedef struct { double value, slope; } term;

static double limited(double value, double limit)
{
    return fmin(fmax(value, -limit), limit);
}

static term stribeck(const constants *c, double slip)
{
    double root = sqrt(fabs(slip) / c->V_s);
    double excess = (c->mu_s - c->mu_c) * exp(-root);
    return (term){c->mu_c + excess, 0.5 * excess * root};
}

static double bristles(const constants *c, double p, double slip, double g, double duration)
{
    if (slip == 0.0)
        return p;
    double settled = copysign(g / c->sigma_0, slip);
    return settled + (p - settled) * exp(-c->sigma_0 * fabs(slip) * duration / g);
}

static term traction(const constants *c, double p, double slip, term g)
{
    double stress = c->sigma_0 * p / g.value;
    double turn = c->sigma_1 * stress * (1.0 + g.slope / g.value);
    double force = c->sigma_0 * p + c->sigma_1 * (slip - fabs(slip) * stress) + c->sigma_2 * slip;
    double slope = c->sigma_1 + c->sigma_2 - (slip > 0.0 ? turn : slip < 0.0 ? -turn : 0.0);
    return (term){c->weight * force, c->weight * slope};
}

static term lateral_force(const constants *c, double speed)
{
    if (c->coupling == 2.0)
        return (term){0.0, 0.0};
    double sign = tanh(speed / c->smooth);
    double s = c->roller_dry * sign + c->roller_viscous * speed;
    double slope = c->roller_dry * (1.0 - sign * sign) / c->smooth + c->roller_viscous;
    if (c->coupling == 0.0) {
        double j = c->row_distance, k = c->mass_offset, share = c->weight * (j + 2.0 * k);
        if (-k - s * c->height < 0.0) {
            double rest = j - 2.0 * s * c->height;
            return (term){s * share / rest, slope * share * j / (rest * rest)};
        }
        if (k + j + s * c->height < 0.0) {
            double rest = j + 2.0 * s * c->height;
            return (term){-s * share / rest, -slope * share * j / (rest * rest)};
        }
    }
    return (term){s * c->weight, slope * c->weight};
}

static term servo(double gain, double integral, double limit, double error, double sum)
{
    double force = gain * error + integral * sum;
    if (force > limit)
        return (term){limit, 0.0};
    if (force < -limit)
        return (term){-limit, 0.0};
    return (term){force, -gain};
}

static int winding(double gain, double integral, double limit, double error, double sum)
{
    double force = gain * error + integral * sum;
    return fabs(force) <= limit || error * force < 0.0;
}

static term end_stop(double low, double high, double stiffness, double damping, double position,
                     double speed)
{
    double force = 0.0;
    if (position > high)
        force = fmin(-stiffness * (position - high) - damping * speed, 0.0);
    else if (position < low)
        force = fmax(stiffness * (low - position) - damping * speed, 0.0);
    return (term){force, force != 0.0 ? -damping : 0.0};
}

static term lateral_rate(const constants *c, const state *s, double target, int engaged)
{
    double vz = s->vz, sign = tanh(vz / c->smooth);
    term force = {0.0, 0.0}, roller = lateral_force(c, vz);
    term stop = end_stop(c->z_low, c->z_high, c->z_stiffness, c->z_damping, s->z, vz);
    if (engaged)
        force = servo(c->lateral_kp, c->lateral_ki, c->lateral_limit, target - vz, s->lateral_sum);
    double rail = c->rail_dry * sign + c->rail_viscous * vz;
    double rail_slope = c->rail_dry * (1.0 - sign * sign) / c->smooth + c->rail_viscous;
    return (term){(force.value - rail - roller.value + stop.value) / c->lateral_mass,
                  (force.slope - rail_slope - roller.slope + stop.slope) / c->lateral_mass};
}

void integrate(const constants *c, state *s, const commands *u, double step, long steps)
{
    double demand = u->wheel_enabled > 0.5 ? limited(u->wheel_current, c->current_limit) : 0.0;
    double belt = limited(u->belt_speed, c->belt_speed);
    double across = limited(u->lateral_speed, c->lateral_speed);
    int belt_on = u->belt_engaged > 0.5, lateral_on = u->lateral_engaged > 0.5;
    if (!belt_on)
        s->belt_sum = 0.0;
    if (!lateral_on)
        s->lateral_sum = 0.0;
    int bridge = (lateral_on && across != 0.0) || fabs(s->vz) + fabs(s->lateral_sum) > 1e-12;
    if (!bridge && c->z_low <= s->z && s->z <= c->z_high)
        s->vz = s->lateral_sum = 0.0;
    else
        bridge = 1;
    double half = 0.5 * step;
    double keep_step = exp(-c->loop_rate * step), keep_half = exp(-c->loop_rate * half);
    double v = s->v, w = s->w, slip = c->r * w - v, duration = half, keep = keep_half;
    term g = stribeck(c, slip);

    for (long n = 0;; n++) {
        s->p = bristles(c, s->p, slip, g.value, duration);
        double emf = c->back_emf * c->gear * w;
        double goal = fmin(fmax(demand, (-c->supply - emf) / c->resistance),
                           (c->supply - emf) / c->resistance);
        s->i = goal + (s->i - goal) * keep;
        s->x += v * duration;
        s->theta += w * duration;
        if (belt_on && winding(c->belt_kp, c->belt_ki, c->belt_limit, belt - v, s->belt_sum))
            s->belt_sum += (belt - v) * duration;
        if (bridge) {
            double error = across - s->vz;
            s->z += s->vz * duration;
            if (lateral_on &&
                winding(c->lateral_kp, c->lateral_ki, c->lateral_limit, error, s->lateral_sum))
                s->lateral_sum += error * duration;
        }
        if (n == steps)
            break;
        double lateral = 0.0;
        if (bridge) {
            term rate = lateral_rate(c, s, across, lateral_on);
            double slope = rate.value / (1.0 - half * rate.slope);
            lateral = lateral_force(c, s->vz + half * slope).value;
            s->vz += step * slope;
        }

        term force = traction(c, s->p, slip, g);
        double moment = fabs(c->guide_moment - lateral * c->height) / c->half_span;
        double guide_load = fmax(fabs(lateral), moment), tilt = lateral * c->r;
        double near = (c->weight * (c->spacing + c->overhang) - tilt) / c->spacing;
        double far = (c->weight * c->overhang - tilt) / c->spacing;
        double arm = c->bearing_arm * (fabs(near) + fabs(far));
        double sign = tanh(v / c->smooth), dry = c->guide_dry * guide_load;
        double rolling = c->rolling * c->weight;
        double drag = dry * sign + c->guide_viscous * guide_load * v + rolling * sign;
        double drag_slope =
            (dry + rolling) * (1.0 - sign * sign) / c->smooth + c->guide_viscous * guide_load;
        double rim = tanh(c->r * w / c->smooth), rim_slope = (1.0 - rim * rim) * c->r / c->smooth;
        double no_load = c->no_load_dry * rim + c->no_load_viscous * c->gear * w;
        double torque = (c->torque_constant * s->i - no_load) * c->ratio_efficiency -
                        (c->bearing_dry * rim + c->bearing_viscous * w) * arm;
        double torque_slope =
            -(c->no_load_dry * rim_slope + c->no_load_viscous * c->gear) * c->ratio_efficiency -
            (c->bearing_dry * rim_slope + c->bearing_viscous) * arm;
        term pull = {0.0, 0.0};
        if (belt_on)
            pull = servo(c->belt_kp, c->belt_ki, c->belt_limit, belt - v, s->belt_sum);
        term stop = end_stop(c->x_low, c->x_high, c->x_stiffness, c->x_damping, s->x, v);
        double shake = c->ripple > 0.0 ? c->ripple * sin(c->transitions * s->theta) : 0.0;
        double fv = (force.value - drag + pull.value + stop.value) / c->mass + shake * v;
        double fw = (torque - c->r * force.value) / c->inertia;
        double vv = (pull.slope + stop.slope - force.slope - drag_slope) / c->mass + shake;
        double vw = c->r * force.slope / c->mass, wv = c->r * force.slope / c->inertia;
        double ww = (torque_slope - c->r * c->r * force.slope) / c->inertia;
        double a = 1.0 - half * vv, b = 1.0 - half * ww;
        double scale = step / (a * b - half * half * vw * wv);
        v += scale * (b * fv + half * vw * fw);
        w += scale * (a * fw + half * wv * fv);
        slip = c->r * w - v;
        g = stribeck(c, slip);
        duration = n == steps - 1 ? half : step;
        keep = n == steps - 1 ? keep_half : keep_step;
    }
    s->v = v;
    s->w = w;
}
