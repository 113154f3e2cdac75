/* A robot of modules in a chain, four slipping wheels each, from its paper and docs/physics/articulated.md alone, with
 * faults that a robot can have. SI. Places are complex numbers: the centre of module i is p + sum_j chain[i][j] e^(i th_j),
 * so that a hinge may be aside and a centre of mass off. Classical Runge-Kutta with a fixed step. */
#include <complex.h>
#include <math.h>
#include <string.h>

enum { /* of the robot */
  GRAVITY, MU_S, MU_D, REST_SPEED, KP, KI, TORQUE_LIMIT, CENTRE_HEIGHT, TRANSFER, TRANSFER_TIME,
  SLOPE_X, SLOPE_Y, DRAG, DRAG_SQUARED, SCRAPE, SCRAPE_ASIDE, TETHER, HINGE_SPRING, HINGE_DAMPING, HINGE_DRY, HINGE_STOP,
  PATCH, PATCH_AT, PILE, POWER, POWER_SPEED, FALLING, FALLING_SPEED, ROLLING_SPEED, WARMING, WARMING_TIME, GRADUAL,
  TORQUE_RIPPLE, RIPPLES, BANDWIDTH, CONSTANTS
};
enum { MASS, INERTIA, MASS_AHEAD, MASS_ASIDE, HALF_TRACK, HALF_WHEELBASE, AHEAD, BEHIND, AHEAD_ASIDE, BEHIND_ASIDE, WHEEL_MASS,
       WHEEL_YAW, OF_MODULE };
enum { RADIUS, K_LON, K_LAT, K_ROLL, LOAD, STATIC, KINETIC, TOE, ECCENTRIC, PHASE, OF_WHEEL };
enum { DRIVEN, WHEEL_INERTIA, GEAR, ROTOR, DRY, VISCOUS, OF_UNIT };
enum { MOST = 4, N = 2 + MOST, WHEELS = 4 * MOST, UNITS = 2 * MOST };
enum { P, V = 2, TH = 4, W = TH + MOST, PHI = W + MOST, SPIN = PHI + UNITS, Z = SPIN + UNITS, AX = Z + UNITS, AY = AX + MOST, STATES = AY + MOST };

typedef struct {
  int n;
  const double *k, *modules, *wheels, *units;
  complex double chain[MOST][MOST], mass_of[MOST][MOST], at[WHEELS];
  double mass[MOST], inertia[MOST], torque[UNITS];
} Robot;

static double dot2(complex double a, complex double b) { return creal(a) * creal(b) + cimag(a) * cimag(b); }

static void prepare(Robot *r) {
  for (int i = 0; i < r->n; i++) {
    const double *m = r->modules + OF_MODULE * i;
    for (int j = 0; j < r->n; j++) {
      const double *o = r->modules + OF_MODULE * j;
      complex double to_front = j > 0 ? o[AHEAD] + I * o[AHEAD_ASIDE] : 0, to_rear = -o[BEHIND] + I * o[BEHIND_ASIDE];
      r->chain[i][j] = j > i ? 0 : j == i ? -to_front : to_rear - to_front;
    }
    complex double c = m[MASS_AHEAD] + I * m[MASS_ASIDE];
    double wheels = 4 * m[WHEEL_MASS], all = m[MASS] + wheels;
    complex double centre = m[MASS] * c / all;
    double inertia = m[INERTIA] + 4 * m[WHEEL_YAW] + m[MASS] * pow(cabs(c - centre), 2);
    for (int w = 0; w < 4; w++) {
      r->at[4 * i + w] = (w < 2 ? 1 : -1) * m[HALF_WHEELBASE] + I * (w % 2 ? 1 : -1) * m[HALF_TRACK];
      inertia += m[WHEEL_MASS] * pow(cabs(r->at[4 * i + w] - centre), 2);
    }
    for (int j = 0; j < r->n; j++) r->mass_of[i][j] = r->chain[i][j] + (i == j ? centre : 0);
    r->mass[i] = all;
    r->inertia[i] = inertia;
  }
}

static double level(const double *k, double t, double x) {
  return (1 + k[PATCH] * 0.5 * (1 + tanh((x - k[PATCH_AT]) / 0.01))) * (1 + k[WARMING] * (1 - exp(-t / k[WARMING_TIME])));
}

/* the reference of each unit; a module that follows gets the speeds of its side */
static double reference(const double *asked, int unit, double t) {
  double goal = asked[unit % 2], ramp = asked[2];
  double s = t < asked[3] ? 0 : t < asked[3] + ramp ? (t - asked[3]) / ramp : 1;
  if (t > asked[4]) s *= fmax(0, 1 - (t - asked[4]) / 0.5);
  return goal * s;
}

static void slopes(Robot *r, double t, const double *y, const double *asked, double *dy) {
  const double *k = r->k;
  int n = r->n, size = 2 + n;
  complex double e[MOST], force[MOST], v[MOST];
  double a[N][N + 1], moment[MOST], grip[UNITS], roll[UNITS];
  memset(a, 0, sizeof a);
  memset(dy, 0, STATES * sizeof *dy);
  complex double pv = y[V] + I * y[V + 1];
  for (int i = 0; i < n; i++) e[i] = cexp(I * y[TH + i]);
  double shared = level(k, t, y[P]);
  for (int i = 0; i < n; i++) {
    const double *m = r->modules + OF_MODULE * i;
    v[i] = pv;
    for (int j = 0; j <= i; j++) v[i] += r->chain[i][j] * I * y[W + j] * e[j];
    force[i] = 0;
    moment[i] = 0;
    grip[2 * i] = grip[2 * i + 1] = roll[2 * i] = roll[2 * i + 1] = 0;
    complex double own = v[i] * conj(e[i]);
    for (int w = 0; w < 4; w++) {
      const double *c = r->wheels + OF_WHEEL * (4 * i + w);
      complex double place = r->at[4 * i + w], turned = cexp(I * c[TOE]);
      int unit = 2 * i + w % 2;
      complex double velocity = (own + I * y[W + i] * place) * conj(turned);
      double radius = c[RADIUS] * (1 + c[ECCENTRIC] * sin(y[PHI + unit] + c[PHASE]));
      double slip = radius * y[SPIN + unit] - creal(velocity), aside = cimag(velocity);
      double load = c[LOAD];
      if (k[TRANSFER] != 0) {
        double along = m[MASS] * y[AX + i] * k[CENTRE_HEIGHT] / (4 * fabs(creal(place)));
        double side = m[MASS] * y[AY + i] * k[CENTRE_HEIGHT] / (4 * fabs(cimag(place)));
        load = fmax(0.05 * load, load - k[TRANSFER] * ((w < 2 ? along : -along) + (w % 2 ? side : -side)));
      }
      double in_proportion = load / c[LOAD] * shared, pile = k[PILE] * cos(2 * y[TH + i]);
      double lon = c[K_LON] * in_proportion * (1 + pile) * slip, lat = -c[K_LAT] * in_proportion * (1 - pile) * aside;
      if (k[POWER] != 0) {
        double bent = pow(hypot(slip, aside) / k[POWER_SPEED] + 1e-9, k[POWER]);
        lon *= bent;
        lat *= bent;
      }
      double trial = hypot(lon, lat), most = k[MU_S] * c[STATIC] * load, sliding = k[MU_D] * c[KINETIC] * load;
      if (k[FALLING] != 0) sliding *= 1 + k[FALLING] * (exp(-hypot(slip, aside) / k[FALLING_SPEED]) - 0.5);
      if (k[GRADUAL] != 0) {
        double share = 0.5 * (1 + tanh((trial / most - 1) / k[GRADUAL]));
        double carried = (1 - share) * fmin(trial, most) + share * sliding;
        if (trial > 1e-12) { lon *= carried / trial; lat *= carried / trial; }
      } else if (trial > most) {
        lon *= sliding / trial;
        lat *= sliding / trial;
      }
      complex double f = (lon + I * lat) * turned;
      force[i] += f;
      moment[i] += cimag(conj(place) * f);
      grip[unit] += radius * lon;
      roll[unit] += c[K_ROLL] * load * (1 + k[ROLLING_SPEED] * fabs(y[SPIN + unit]) / 10);
    }
    force[i] *= e[i];
    double speed = cabs(v[i]) + 1e-9;
    complex double along = v[i] / speed;
    force[i] += -(k[DRAG] * tanh(speed / 0.005) + k[DRAG_SQUARED] * speed * speed) * along;
    if (i == n - 1) {
      complex double spot = I * k[SCRAPE_ASIDE], moves = own + I * y[W + i] * spot;
      complex double scrape = -k[SCRAPE] * tanh(cabs(moves) / 0.005) * moves / (cabs(moves) + 1e-9);
      moment[i] += cimag(conj(spot) * scrape);
      force[i] += scrape * e[i];
      complex double from = y[P] + I * y[P + 1];
      force[i] += -k[TETHER] * tanh(cabs(from) / 0.05) * from / (cabs(from) + 1e-9);
    }
    /* the hinge before this module */
    if (i > 0) {
      double angle = y[TH + i - 1] - y[TH + i], rate = y[W + i - 1] - y[W + i];
      double beyond = fmax(0, fabs(angle) - k[HINGE_STOP]);
      double turn = k[HINGE_SPRING] * angle + k[HINGE_DAMPING] * rate + k[HINGE_DRY] * tanh(rate / 0.02) +
                    (beyond > 0 ? 50 * copysign(beyond, angle) + 1.0 * rate : 0);
      moment[i - 1] -= turn;
      moment[i] += turn;
    }
  }
  /* generalised coordinates x, y, th_1 .. th_n: sum of m (dr/dq_a . dr/dq_b), and forces less m (r'' at rest of q'') */
  for (int i = 0; i < n; i++) {
    double mass = r->mass[i];
    complex double rest = 0;
    for (int j = 0; j <= i; j++) rest -= r->mass_of[i][j] * y[W + j] * y[W + j] * e[j];
    complex double left = -mass * rest + mass * (k[SLOPE_X] + I * k[SLOPE_Y]) * k[GRAVITY];
    complex double q[MOST];
    for (int j = 0; j <= i; j++) q[j] = I * r->mass_of[i][j] * e[j];
    a[0][0] += mass;
    a[1][1] += mass;
    a[0][size] += creal(force[i] + left);
    a[1][size] += cimag(force[i] + left);
    for (int j = 0; j <= i; j++) {
      a[0][2 + j] += mass * creal(q[j]);
      a[1][2 + j] += mass * cimag(q[j]);
      for (int l = 0; l <= i; l++) a[2 + j][2 + l] += mass * dot2(q[j], q[l]);
      a[2 + j][size] += dot2(q[j], left) + dot2(I * r->chain[i][j] * e[j], force[i]);
    }
    a[2 + i][2 + i] += r->inertia[i];
    a[2 + i][size] += moment[i];
  }
  for (int row = 2; row < size; row++)
    for (int column = 0; column < 2; column++) a[row][column] = a[column][row];
  for (int c = 0; c < size; c++) /* positive definite: no pivots */
    for (int row = c + 1; row < size; row++) {
      double f = a[row][c] / a[c][c];
      for (int o = c; o <= size; o++) a[row][o] -= f * a[c][o];
    }
  double x[N];
  for (int row = size - 1; row >= 0; row--) {
    x[row] = a[row][size];
    for (int o = row + 1; o < size; o++) x[row] -= a[row][o] * x[o];
    x[row] /= a[row][row];
  }
  dy[P] = y[V];
  dy[P + 1] = y[V + 1];
  dy[V] = x[0];
  dy[V + 1] = x[1];
  for (int i = 0; i < n; i++) {
    dy[TH + i] = y[W + i];
    dy[W + i] = x[2 + i];
    complex double acceleration = x[0] + I * x[1];
    for (int j = 0; j <= i; j++) acceleration += r->chain[i][j] * (I * x[2 + j] - y[W + j] * y[W + j]) * e[j];
    acceleration *= conj(e[i]);
    dy[AX + i] = (creal(acceleration) - y[AX + i]) / k[TRANSFER_TIME];
    dy[AY + i] = (cimag(acceleration) - y[AY + i]) / k[TRANSFER_TIME];
  }
  for (int u = 0; u < 2 * n; u++) {
    const double *d = r->units + OF_UNIT * u;
    double tau = 0, motor = d[GEAR] * y[SPIN + u];
    if (d[DRIVEN] != 0) {
      double error = reference(asked, u, t) - motor, wanted = k[KP] * error + y[Z + u];
      tau = fmax(-k[TORQUE_LIMIT], fmin(k[TORQUE_LIMIT], wanted));
      dy[Z + u] = tau == wanted ? k[KI] * error : 0;
    }
    r->torque[u] = tau;
    double given = tau - d[DRY] * tanh(motor / 5) - d[VISCOUS] * motor;
    if (k[TORQUE_RIPPLE] != 0 && d[DRIVEN] != 0) given += k[TORQUE_RIPPLE] * sin(k[RIPPLES] * d[GEAR] * y[PHI + u]);
    double inertia = 2 * d[WHEEL_INERTIA] + d[GEAR] * d[GEAR] * d[ROTOR];
    dy[PHI + u] = y[SPIN + u];
    dy[SPIN + u] = (d[GEAR] * given - grip[u] - roll[u] * tanh(y[SPIN + u] / k[REST_SPEED])) / inertia;
  }
}

/* Plays rows of `every` steps. A row of out: t, then by module x, y (of its centre), heading, then by unit the speed and torque
 * of its motor and the angle of its wheels. */
long play(const double *k, const double *modules, const double *wheels, const double *units, long n, const double *asked,
          const double *begin, double step, long every, long rows, double *out) {
  Robot r = {.n = (int)n, .k = k, .modules = modules, .wheels = wheels, .units = units};
  prepare(&r);
  double y[STATES] = {0}, d[4][STATES], at[STATES];
  for (int i = 0; i < n; i++) y[TH + i] = begin[2 + i];
  y[P] = begin[0];
  y[P + 1] = begin[1];
  for (long row = 0; row < rows; row++) {
    double t = row * every * step, *o = out + row * (1 + 3 * n + 6 * n);
    slopes(&r, t, y, asked, d[0]);
    *o++ = t;
    for (int i = 0; i < n; i++) {
      complex double centre = y[P] + I * y[P + 1];
      for (int j = 0; j <= i; j++) centre += r.chain[i][j] * cexp(I * y[TH + j]);
      *o++ = creal(centre);
      *o++ = cimag(centre);
      *o++ = y[TH + i];
    }
    for (int u = 0; u < 2 * n; u++) {
      *o++ = units[OF_UNIT * u + GEAR] * y[SPIN + u];
      *o++ = r.torque[u];
      *o++ = y[PHI + u];
    }
    for (long s = 0; s < every; s++) {
      double now = t + s * step;
      slopes(&r, now, y, asked, d[0]);
      for (int q = 1; q < 4; q++) {
        double ahead = q < 3 ? 0.5 * step : step;
        for (int i = 0; i < STATES; i++) at[i] = y[i] + ahead * d[q - 1][i];
        slopes(&r, now + ahead, at, asked, d[q]);
      }
      for (int i = 0; i < STATES; i++) y[i] += step / 6 * (d[0][i] + 2 * d[1][i] + 2 * d[2][i] + d[3][i]);
    }
  }
  return rows;
}
