/* The LuGre omni-wheel rig from its paper and docs/physics/lugre.md alone, with faults that a rig can have.
 * SI. Classical Runge-Kutta with a fixed step; every row of the result is one sample of the true state. */
#include <math.h>

enum { /* constants of the rig: the order is that of NAMES in rig.py */
  MASS, LOAD, RADIUS, WHEEL_INERTIA, MOTOR_INERTIA, GEAR, EFFICIENCY, TORQUE, BACK_EMF, RESISTANCE, SUPPLY, BANDWIDTH,
  NO_LOAD, NO_LOAD_VISCOUS, BEARING, GUIDE, GUIDE_VISCOUS, ROLLING, SLOPE, DRAG, CABLE_SPRING,
  V_S, MU_C, MU_S, SIGMA_0, SIGMA_1, SIGMA_2, EXPONENT, ROLLERS, RIPPLE, RIPPLE_PHASE,
  /* what can be wrong */
  STEP_SIZE, STEP_AT, PATCH_SIZE, PATCH_AT, PATCH_WIDTH, WAVE_SIZE, WAVE_LENGTH, TURN_SIZE, TURN_PHASE,
  AGE_SIZE, AGE_LENGTH, HEAT_SIZE, HEAT_TIME, BACKWARD, ECCENTRIC, ECCENTRIC_PHASE, SECOND_HARMONIC,
  STIFFNESS, BACKLASH, COUPLING_DAMPING, HOP, LOAD_SLOPE, GUIDE_WAVE, GUIDE_LENGTH, GUIDE_STICTION,
  TORQUE_RIPPLE, TORQUE_RIPPLES, COGGING, FADE, FADE_TIME, BACK_DRIVE, CURRENT_DEAD, TOUCH_FORCE, TOUCH_AT, TOUCH_TIME,
  FLAT_FORCE, FLAT_WIDTH, CLUTCH_DRAG, RUN_IN, RUN_IN_LENGTH, RELAXATION, TILT_LOAD, AIR,
  /* lateral motion, equations 21 to 26 and 48 */
  ROLLER_DRY, ROLLER_VISCOUS, LEVER, HEIGHT, HALF_SPAN, ROWS, OFFSET, SPACING, OVERHANG, LIFTED_RUBS_NOT, ROLLER_SIDE,
  ROLLER_POWER, SIDE_PULL,
  /* other laws of friction: 1/(1 + share^exponent) in place of exp(-share^exponent), and a slip below which g is mu_s */
  LORENTZ, PLATEAU, CONSTANTS
};
enum { I, W, P, V, X, TH, WM, THM, AGE, HEAT, BELT, FADED, VZ, STATES };
enum { ENGAGED, SPEED, SHAPE, AMPLITUDE, FREQUENCY, LASTING, STOP_AT, SECOND, RECORDED, LATERAL, PHASE };

static const double EPS = 1e-3, G = 9.81;
static double sgn(double u) { return tanh(u / EPS); }

typedef struct { double acceleration, traction, belt; } Forces;

static double level(const double *k, const double *y) {
  double d = (y[X] - k[PATCH_AT]) / k[PATCH_WIDTH];
  double s = 1 + k[STEP_SIZE] * 0.5 * (1 + tanh((y[X] - k[STEP_AT]) / 0.004)) + k[PATCH_SIZE] * exp(-d * d) +
             k[WAVE_SIZE] * sin(6.283185307179586 * y[X] / k[WAVE_LENGTH]) + k[TURN_SIZE] * sin(y[TH] + k[TURN_PHASE]) -
             k[HEAT_SIZE] * y[HEAT] + k[RUN_IN] * exp(-fmax(y[X], 0) / k[RUN_IN_LENGTH]);
  return s > 0.05 ? s : 0.05;
}

/* The lateral force of the rollers for the speed of the bridge; a lifted row rubs as Eq. 26 is printed, or not at all. */
static double lateral(const double *k, double vz) {
  double weight = k[MASS] * G, power = k[ROLLER_POWER] != 0 ? k[ROLLER_POWER] : 1;
  double s = k[ROLLER_DRY] * sgn(vz) + k[ROLLER_VISCOUS] * vz * pow(fabs(vz) / 0.5 + 1e-12, power - 1);
  s *= 1 + k[ROLLER_SIDE] * sgn(vz);
  if (k[LIFTED_RUBS_NOT] == 0 && -k[OFFSET] - s * k[HEIGHT] < 0)
    return s * weight * (k[ROWS] + 2 * k[OFFSET]) / (k[ROWS] - 2 * s * k[HEIGHT]);
  if (k[LIFTED_RUBS_NOT] == 0 && k[OFFSET] + k[ROWS] + s * k[HEIGHT] < 0)
    return -s * weight * (k[ROWS] + 2 * k[OFFSET]) / (k[ROWS] + 2 * s * k[HEIGHT]);
  return s * weight;
}

static Forces slopes(const double *k, const double *y, const double *f, double reference, double touch, double *dy) {
  double engaged = f[ENGAGED], speed = f[SPEED];
  Forces out;
  double lever = k[RADIUS] * (1 + k[ECCENTRIC] * sin(y[TH] + k[ECCENTRIC_PHASE]) +
                              k[SECOND_HARMONIC] * sin(2 * y[TH] + k[ECCENTRIC_PHASE]));
  double slip = lever * y[W] - y[V], speed_of = fabs(slip), share = level(k, y);
  double fallen = pow(fmax(speed_of - k[PLATEAU], 0) / k[V_S], k[EXPONENT]);
  double g = k[MU_C] + (k[MU_S] - k[MU_C]) * (k[LORENTZ] != 0 ? 1 / (1 + fallen) : exp(-fallen));
  if (k[AGE_SIZE] != 0) g *= 1 + k[AGE_SIZE] * log(1 + y[AGE] / 0.1);
  if (slip < 0) g *= 1 + k[BACKWARD];
  g *= share;
  double load = k[LOAD] * (1 + k[HOP] * y[V] * y[V] * sin(k[ROLLERS] * y[TH])) + k[LOAD_SLOPE] * y[X];
  double rate = slip - k[SIGMA_0] * speed_of * y[P] / g - k[RELAXATION] * fabs(lever * y[W]) * y[P];
  load += k[TILT_LOAD] * k[LOAD] * (k[SIGMA_0] * y[P] + k[SIGMA_2] * slip);
  double traction = load * (k[SIGMA_0] * y[P] + k[SIGMA_1] * rate + k[SIGMA_2] * share * slip);
  double turn = fmod(y[TH], 6.283185307179586) / k[FLAT_WIDTH];
  double flat = k[FLAT_FORCE] * y[V] * turn * exp(-turn * turn);
  double guide = k[GUIDE] * (1 + k[GUIDE_WAVE] * sin(6.283185307179586 * y[X] / k[GUIDE_LENGTH]) +
                             k[GUIDE_STICTION] * exp(-fabs(y[V]) / 0.05)) +
                 k[CLUTCH_DRAG] * (1 - engaged);
  double rubs = k[BEARING];
  if (k[LEVER] != 0) { /* the guide's reactions and the loads of the bearings over those without lateral force */
    double weight = k[MASS] * G, side = lateral(k, y[VZ]), pulled = side + k[SIDE_PULL];
    double moment = weight * k[LEVER] - pulled * k[HEIGHT];
    guide *= fmax(fabs(pulled) * k[HALF_SPAN], fabs(moment)) / (weight * fabs(k[LEVER]));
    double inner = weight * (k[SPACING] + k[OVERHANG]) - side * k[RADIUS], outer = weight * k[OVERHANG] - side * k[RADIUS];
    rubs *= (fabs(inner) + fabs(outer)) / (weight * (k[SPACING] + 2 * k[OVERHANG]));
  }
  double aside = (f[LATERAL] - y[VZ]) / 0.004;
  dy[VZ] = aside > 5 ? 5 : aside < -5 ? -5 : aside;
  double belt = 0;
  dy[BELT] = 0;
  if (engaged > 0) {
    belt = 400 * (speed - y[V]) + 8000 * y[BELT];
    if (belt > 80) belt = 80;
    else if (belt < -80) belt = -80;
    else dy[BELT] = speed - y[V];
  }
  double resist = guide * sgn(y[V]) + k[GUIDE_VISCOUS] * y[V] + k[ROLLING] * k[MASS] * G * sgn(y[V]) + k[DRAG] * y[V] +
                  k[AIR] * y[V] * fabs(y[V]) + k[CABLE_SPRING] * y[X];
  double a = (traction - resist + belt + touch + flat) / k[MASS] - k[SLOPE] + k[RIPPLE] * y[V] * sin(k[ROLLERS] * y[TH] + k[RIPPLE_PHASE]);
  int loose = k[STIFFNESS] > 0;
  double wm = loose ? y[WM] : y[W], thm = loose ? y[THM] : y[TH];
  double emf = k[BACK_EMF] * k[GEAR] * wm;
  double top = (k[SUPPLY] - emf) / k[RESISTANCE], low = (-k[SUPPLY] - emf) / k[RESISTANCE];
  double wanted = fabs(reference) < k[CURRENT_DEAD] ? 0 : reference;
  wanted = wanted > top ? top : wanted < low ? low : wanted;
  dy[I] = 6.283185307179586 * k[BANDWIDTH] * (wanted - y[I]);
  double kt = k[TORQUE] * (1 + k[TORQUE_RIPPLE] * sin(k[TORQUE_RIPPLES] * thm) - k[FADE] * y[FADED]);
  double motor = kt * y[I] - k[NO_LOAD] * sgn(k[RADIUS] * wm) - k[NO_LOAD_VISCOUS] * k[GEAR] * wm +
                 k[COGGING] * sin(k[TORQUE_RIPPLES] * thm);
  double share_of_gear = k[BACK_DRIVE] > 0 && motor * wm < 0 ? 1 / k[EFFICIENCY] : k[EFFICIENCY];
  double torque = motor * share_of_gear * k[GEAR];
  double rotor = k[MOTOR_INERTIA] * k[EFFICIENCY] * k[GEAR] * k[GEAR];
  double against = rubs * sgn(k[RADIUS] * y[W]) + lever * traction;
  if (loose) {
    double twist = thm - y[TH], half = 0.5 * k[BACKLASH];
    double gap = twist > half ? twist - half : twist < -half ? twist + half : 0;
    double spring = gap == 0 && half > 0 ? 0 : k[STIFFNESS] * gap + k[COUPLING_DAMPING] * (wm - y[W]);
    dy[WM] = (torque - spring) / rotor;
    dy[W] = (spring - against) / k[WHEEL_INERTIA];
  } else {
    dy[W] = (torque - against) / (k[WHEEL_INERTIA] + rotor);
    dy[WM] = dy[W];
  }
  dy[THM] = wm;
  dy[P] = rate;
  dy[V] = a;
  dy[X] = y[V];
  dy[TH] = y[W];
  dy[AGE] = k[AGE_SIZE] != 0 ? 1 - speed_of * y[AGE] / k[AGE_LENGTH] : 0;
  dy[HEAT] = k[HEAT_SIZE] != 0 ? (fabs(traction * slip) - y[HEAT]) / k[HEAT_TIME] : 0;
  dy[FADED] = k[FADE] != 0 ? (y[I] * y[I] - y[FADED]) / k[FADE_TIME] : 0;
  out.acceleration = a;
  out.traction = traction;
  out.belt = belt;
  return out;
}

/* Plays `phases` from the state `y`; `cycle` s is the period of the control, `parts` rows are kept of each cycle, and
 * each row is `substeps` steps. Returns the rows that were written, at most `most`: t, phase, engaged, reference, i,
 * motor angle, wheel angle, wheel speed, x, v, a, p, traction, lateral speed. */
long play(const double *k, double *y, const double *phases, long count, double cycle, long parts, long substeps,
          double *rows, long most) {
  double t = 0, h = cycle / (double)(parts * substeps), a[STATES], b[STATES], c[STATES], d[STATES], z[STATES];
  long n = 0;
  for (long q = 0; q < count; q++) {
    const double *f = phases + q * PHASE;
    double since = 0, changed = -1;
    y[BELT] = 0;
    while (since < f[LASTING] - 0.5 * cycle) {
      double reference = f[AMPLITUDE];
      if (y[X] > f[STOP_AT] && f[SHAPE] != 2) break;
      if (f[SHAPE] == 1) reference *= (1 - since / f[LASTING]) * sin(6.283185307179586 * f[FREQUENCY] * since);
      if (f[SHAPE] == 2) { /* changes to the second current beyond STOP_AT for FREQUENCY s */
        if (changed < 0 && y[X] > f[STOP_AT]) changed = since;
        if (changed >= 0) reference = f[SECOND];
        if (changed >= 0 && since > changed + f[FREQUENCY]) break;
        if (y[X] > 1.15) break;
      }
      if (f[SHAPE] == 3) reference += (f[SECOND] - f[AMPLITUDE]) * fmin(since / f[FREQUENCY], 1);
      for (long m = 0; m < parts; m++) {
        for (long s = 0; s < substeps; s++) {
          double now = since + (double)(m * substeps + s) * h;
          double touch = f[RECORDED] == 2 && now >= k[TOUCH_AT] && now < k[TOUCH_AT] + k[TOUCH_TIME] ? k[TOUCH_FORCE] : 0;
          Forces force = slopes(k, y, f, reference, touch, a);
          if (s == 0 && f[RECORDED] > 0) {
            if (n >= most) return -1;
            double *r = rows + n++ * 14;
            r[0] = t + (double)m * cycle / (double)parts, r[1] = (double)q, r[2] = f[ENGAGED], r[3] = reference, r[4] = y[I];
            r[5] = k[STIFFNESS] > 0 ? y[THM] : y[TH], r[6] = y[TH], r[7] = y[W], r[8] = y[X], r[9] = y[V];
            r[10] = force.acceleration, r[11] = y[P], r[12] = force.traction, r[13] = y[VZ];
          }
          for (int j = 0; j < STATES; j++) z[j] = y[j] + 0.5 * h * a[j];
          slopes(k, z, f, reference, touch, b);
          for (int j = 0; j < STATES; j++) z[j] = y[j] + 0.5 * h * b[j];
          slopes(k, z, f, reference, touch, c);
          for (int j = 0; j < STATES; j++) z[j] = y[j] + h * c[j];
          slopes(k, z, f, reference, touch, d);
          for (int j = 0; j < STATES; j++) y[j] += h / 6 * (a[j] + 2 * b[j] + 2 * c[j] + d[j]);
        }
      }
      since += cycle;
      if (f[RECORDED] > 0) t += cycle;
    }
  }
  return n;
}
