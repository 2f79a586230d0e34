/* Law K with the damped inverse on ideal joints, as one writes it by hand: pose and Jacobian J of the hand's [w ; dp/dt],
   the twist t that is nearest to K vec8(1 - x* xd), u = J' (J J' + diag(l^2 / c^2, l^2))^-1 t by Cholesky, q += T u.
   Chains as in robots/kinematics/kinematics_kernels.py, revolute joints. */
#include <math.h>
#include <string.h>

#define MOST 60

/* Pose x, position p and Jacobian J of the inertial twist. */
static void twist_kinematics(const double *chain, const double *q, int n, double *x, double *p, double J[6][MOST])
{
    double w = 1, i = 0, j = 0, k = 0, px = 0, py = 0, pz = 0;
    for (int c = 0; c <= n; c++) {
        const double *f = chain + 8 * c, *t = f + 4;
        double cx = 2 * (j * t[2] - k * t[1]), cy = 2 * (k * t[0] - i * t[2]), cz = 2 * (i * t[1] - j * t[0]);
        px += t[0] + w * cx + j * cz - k * cy;
        py += t[1] + w * cy + k * cx - i * cz;
        pz += t[2] + w * cz + i * cy - j * cx;
        double a = w * f[0] - i * f[1] - j * f[2] - k * f[3], b = w * f[1] + i * f[0] + j * f[3] - k * f[2];
        double d = w * f[2] - i * f[3] + j * f[0] + k * f[1], e = w * f[3] + i * f[2] - j * f[1] + k * f[0];
        w = a, i = b, j = d, k = e;
        if (c == n)
            break;
        double zx = 2 * (i * k + w * j), zy = 2 * (j * k - w * i), zz = 1 - 2 * (i * i + j * j);
        J[0][c] = zx, J[1][c] = zy, J[2][c] = zz;
        J[3][c] = py * zz - pz * zy, J[4][c] = pz * zx - px * zz, J[5][c] = px * zy - py * zx;
        double co = cos(0.5 * q[c]), si = sin(0.5 * q[c]);
        a = w * co - k * si, b = i * co + j * si, d = j * co - i * si, e = k * co + w * si;
        w = a, i = b, j = d, k = e;
    }
    p[0] = px, p[1] = py, p[2] = pz;
    px *= 0.5, py *= 0.5, pz *= 0.5;
    x[0] = w, x[1] = i, x[2] = j, x[3] = k;
    x[4] = -px * i - py * j - pz * k, x[5] = px * w + py * k - pz * j;
    x[6] = py * w + pz * i - px * k, x[7] = pz * w + px * j - py * i;
}

static void product(const double *a, const double *b, double *out)
{
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

static void conjugate_product(const double *a, const double *b, double *out)
{
    double p[4] = {a[0], -a[1], -a[2], -a[3]}, d[4] = {a[4], -a[5], -a[6], -a[7]}, one[4], two[4];
    product(p, b, out);
    product(p, b + 4, one);
    product(d, b, two);
    for (int c = 0; c < 4; c++)
        out[4 + c] = one[c] + two[c];
}

/* The twist (w, v) that minimises |vec8(xi x / 2 - rate)|. */
static void nearest_twist(const double *rate, const double *x, double *w, double *v)
{
    double back[4] = {2 * x[0], -2 * x[1], -2 * x[2], -2 * x[3]}, a[4], b[4], d[4];
    product(rate, back, a);
    product(rate + 4, back, b);
    product(x + 4, back, d);
    double dx = 0.5 * d[1], dy = 0.5 * d[2], dz = 0.5 * d[3];
    double correction = (a[1] * dx + a[2] * dy + a[3] * dz + b[0]) / (1 + dx * dx + dy * dy + dz * dz);
    w[0] = a[1] - correction * dx, w[1] = a[2] - correction * dy, w[2] = a[3] - correction * dz;
    v[0] = b[1] - (w[1] * dz - w[2] * dy);
    v[1] = b[2] - (w[2] * dx - w[0] * dz);
    v[2] = b[3] - (w[0] * dy - w[1] * dx);
}

static void rotate(const double *r, const double *v, double *out)
{
    double cx = 2 * (r[2] * v[2] - r[3] * v[1]), cy = 2 * (r[3] * v[0] - r[1] * v[2]), cz = 2 * (r[1] * v[1] - r[2] * v[0]);
    out[0] = v[0] + r[0] * cx + r[2] * cz - r[3] * cy;
    out[1] = v[1] + r[0] * cy + r[3] * cx - r[1] * cz;
    out[2] = v[2] + r[0] * cz + r[1] * cy - r[2] * cx;
}

void closed_loop(const double *chain, int n, double *q, const double *samples, int width, int steps, double period,
                 double gain, double damping, double length, double *q_record, double *command_record)
{
    double x[8], p[3], J[6][MOST], e[8], rate[8], w[3], v[3], t[6], A[6][6];
    double linear = damping * damping, angular = linear / (length * length);
    for (int s = 0; s < steps; s++) {
        const double *xd = samples + (long)s * width;
        memcpy(q_record + (long)s * n, q, n * sizeof *q);
        twist_kinematics(chain, q, n, x, p, J);
        for (int c = 0; c < n; c++) { /* of the hand */
            J[3][c] += J[1][c] * p[2] - J[2][c] * p[1];
            J[4][c] += J[2][c] * p[0] - J[0][c] * p[2];
            J[5][c] += J[0][c] * p[1] - J[1][c] * p[0];
        }
        conjugate_product(x, xd, e);
        double sign = e[0] >= 0 ? 1 : -1;
        for (int c = 0; c < 8; c++)
            e[c] = sign * e[c], rate[c] = gain * e[c];
        rate[0] -= gain;
        nearest_twist(rate, e, w, v);
        rotate(x, w, t);
        rotate(x, v, t + 3);
        for (int r = 0; r < 6; r++) {
            for (int c = 0; c <= r; c++) {
                double sum = 0;
                for (int k = 0; k < n; k++)
                    sum += J[r][k] * J[c][k];
                A[r][c] = sum;
            }
            A[r][r] += r < 3 ? angular : linear;
        }
        for (int c = 0; c < 6; c++) {
            double pivot = A[c][c];
            for (int k = 0; k < c; k++)
                pivot -= A[c][k] * A[c][k];
            pivot = 1 / sqrt(pivot);
            A[c][c] = pivot;
            for (int r = c + 1; r < 6; r++) {
                double sum = A[r][c];
                for (int k = 0; k < c; k++)
                    sum -= A[r][k] * A[c][k];
                A[r][c] = sum * pivot;
            }
        }
        for (int r = 0; r < 6; r++) {
            for (int k = 0; k < r; k++)
                t[r] -= A[r][k] * t[k];
            t[r] *= A[r][r];
        }
        for (int r = 5; r >= 0; r--) {
            for (int k = r + 1; k < 6; k++)
                t[r] -= A[k][r] * t[k];
            t[r] *= A[r][r];
        }
        for (int c = 0; c < n; c++) {
            double u = 0;
            for (int k = 0; k < 6; k++)
                u += J[k][c] * t[k];
            command_record[(long)s * n + c] = u;
            q[c] += period * u;
        }
    }
}
