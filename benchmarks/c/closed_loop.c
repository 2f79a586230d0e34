/* Law K with the damped inverse on ideal joints, as one writes it by hand: pose, pose Jacobian J, N = H-(xd) C8 J,
   u = (N'N + l^2 I)^-1 N' K vec8(1 - x* xd) by Cholesky, q += T u. Chains as in robots/kernels.py, revolute joints. */
#include <math.h>
#include <string.h>

#define MOST 60

static void pose_and_jacobians(const double *chain, const double *q, int n, double *x, double J[8][MOST],
                               double W[6][MOST])
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
        W[0][c] = zx, W[1][c] = zy, W[2][c] = zz;
        W[3][c] = py * zz - pz * zy, W[4][c] = pz * zx - px * zz, W[5][c] = px * zy - py * zx;
        double co = cos(0.5 * q[c]), si = sin(0.5 * q[c]);
        a = w * co - k * si, b = i * co + j * si, d = j * co - i * si, e = k * co + w * si;
        w = a, i = b, j = d, k = e;
    }
    px *= 0.5, py *= 0.5, pz *= 0.5;
    x[0] = w, x[1] = i, x[2] = j, x[3] = k;
    x[4] = -px * i - py * j - pz * k, x[5] = px * w + py * k - pz * j;
    x[6] = py * w + pz * i - px * k, x[7] = pz * w + px * j - py * i;
    double h[8];
    for (int c = 0; c < 8; c++)
        h[c] = 0.5 * x[c];
    for (int c = 0; c < n; c++) {
        double a = W[0][c], b = W[1][c], d = W[2][c], e = W[3][c], f = W[4][c], g = W[5][c];
        J[0][c] = -a * h[1] - b * h[2] - d * h[3];
        J[1][c] = a * h[0] + b * h[3] - d * h[2];
        J[2][c] = b * h[0] + d * h[1] - a * h[3];
        J[3][c] = d * h[0] + a * h[2] - b * h[1];
        J[4][c] = -a * h[5] - b * h[6] - d * h[7] - e * h[1] - f * h[2] - g * h[3];
        J[5][c] = a * h[4] + b * h[7] - d * h[6] + e * h[0] + f * h[3] - g * h[2];
        J[6][c] = b * h[4] + d * h[5] - a * h[7] + f * h[0] + g * h[1] - e * h[3];
        J[7][c] = d * h[4] + a * h[6] - b * h[5] + g * h[0] + e * h[2] - f * h[1];
    }
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

void closed_loop(const double *chain, int n, double *q, const double *samples, int width, int steps, double period,
                 double gain, double damping, double *q_record, double *command_record)
{
    double x[8], J[8][MOST], W[6][MOST], N[8][MOST], e[8], A[MOST][MOST], u[MOST];
    for (int s = 0; s < steps; s++) {
        const double *xd = samples + (long)s * width;
        memcpy(q_record + (long)s * n, q, n * sizeof *q);
        pose_and_jacobians(chain, q, n, x, J, W);
        conjugate_product(x, xd, e);
        double sign = e[0] >= 0 ? 1 : -1;
        for (int c = 0; c < 8; c++)
            e[c] = -sign * e[c];
        e[0] += 1;
        for (int c = 0; c < n; c++) {
            double column[8], moved[8];
            for (int r = 0; r < 8; r++)
                column[r] = J[r][c];
            conjugate_product(column, xd, moved);
            for (int r = 0; r < 8; r++)
                N[r][c] = sign * moved[r];
        }
        for (int r = 0; r < n; r++) {
            for (int c = 0; c <= r; c++) {
                double sum = 0;
                for (int k = 0; k < 8; k++)
                    sum += N[k][r] * N[k][c];
                A[r][c] = sum;
            }
            A[r][r] += damping * damping;
            double sum = 0;
            for (int k = 0; k < 8; k++)
                sum += N[k][r] * gain * e[k];
            u[r] = sum;
        }
        for (int c = 0; c < n; c++) {
            double pivot = A[c][c];
            for (int k = 0; k < c; k++)
                pivot -= A[c][k] * A[c][k];
            pivot = 1 / sqrt(pivot);
            A[c][c] = pivot;
            for (int r = c + 1; r < n; r++) {
                double sum = A[r][c];
                for (int k = 0; k < c; k++)
                    sum -= A[r][k] * A[c][k];
                A[r][c] = sum * pivot;
            }
        }
        for (int r = 0; r < n; r++) {
            for (int k = 0; k < r; k++)
                u[r] -= A[r][k] * u[k];
            u[r] *= A[r][r];
        }
        for (int r = n - 1; r >= 0; r--) {
            for (int k = r + 1; k < n; k++)
                u[r] -= A[k][r] * u[k];
            u[r] *= A[r][r];
        }
        for (int c = 0; c < n; c++) {
            command_record[(long)s * n + c] = u[c];
            q[c] += period * u[c];
        }
    }
}
