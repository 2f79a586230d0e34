/* The loop of closed_loop.c as an expert writes it for one arm: JOINTS is a constant, so that every loop is unrolled;
   sines and cosines of all joints come first, from polynomials that become vector instructions (those of
   robots/kinematics/sin_cos.py, by fdlibm); L D L' replaces the roots of Cholesky. */
#include "closed_loop.c"

#define JOINTS 7
#define LANES 8 /* JOINTS, filled up to whole vectors */
#define UNROLL _Pragma("GCC unroll 8")

static void sines_cosines(const double *angle, double *sine, double *cosine)
{
    const double big = 1.5 * 4503599627370496.0;
    for (int i = 0; i < LANES; i++) {
        double k = (angle[i] * (2 / M_PI) + big) - big;
        double rest = angle[i] - k * 1.57079632673412561417, part = k * 6.07710050630396597660e-11;
        double y = rest - part, error = ((rest - y) - part) - k * 2.02226624879595063154e-21, z = y * y;
        double whole = ((0.5 * k - 0.25) + big) - big, odd = 0.5 * k - whole;
        double behind = 0.5 * whole - (((0.5 * whole - 0.25) + big) - big), sign = 1 - 4 * behind;
        double s = 1.58969099521155010221e-10, c = -1.13596475577881948265e-11;
        s = -2.50507602534068634195e-08 + z * s, c = 2.08757232129817482790e-09 + z * c;
        s = 2.75573137070700676789e-06 + z * s, c = -2.75573143513906633035e-07 + z * c;
        s = -1.98412698298579493134e-04 + z * s, c = 2.48015872894767294178e-05 + z * c;
        s = 8.33333333332248946124e-03 + z * s, c = -1.38888888888741095749e-03 + z * c;
        s = -1.66666666666666324348e-01 + z * s, c = 4.16666666666666019037e-02 + z * c;
        s = y + (z * y * s + error * (1 - 0.5 * z));
        c = 1 - (0.5 * z - (z * z * c - y * error));
        sine[i] = sign * (odd != 0 ? c : s);
        cosine[i] = sign * (1 - 4 * odd) * (odd != 0 ? s : c);
    }
}

static void hand_kinematics(const double *chain, const double *q, double *x, double *p, double J[6][LANES])
{
    double half[LANES] = {0}, sine[LANES], cosine[LANES];
    for (int c = 0; c < JOINTS; c++)
        half[c] = 0.5 * q[c];
    sines_cosines(half, sine, cosine);
    double w = 1, i = 0, j = 0, k = 0, px = 0, py = 0, pz = 0;
    UNROLL for (int c = 0; c <= JOINTS; c++) {
        const double *f = chain + 8 * c, *t = f + 4;
        double cx = 2 * (j * t[2] - k * t[1]), cy = 2 * (k * t[0] - i * t[2]), cz = 2 * (i * t[1] - j * t[0]);
        px += t[0] + w * cx + j * cz - k * cy;
        py += t[1] + w * cy + k * cx - i * cz;
        pz += t[2] + w * cz + i * cy - j * cx;
        double a = w * f[0] - i * f[1] - j * f[2] - k * f[3], b = w * f[1] + i * f[0] + j * f[3] - k * f[2];
        double d = w * f[2] - i * f[3] + j * f[0] + k * f[1], e = w * f[3] + i * f[2] - j * f[1] + k * f[0];
        if (c == JOINTS) {
            w = a, i = b, j = d, k = e;
            break;
        }
        J[0][c] = 2 * (b * e + a * d), J[1][c] = 2 * (d * e - a * b), J[2][c] = 1 - 2 * (b * b + d * d);
        J[3][c] = px, J[4][c] = py, J[5][c] = pz; /* where its axis lies; of the hand below, all joints at once */
        w = a * cosine[c] - e * sine[c], i = b * cosine[c] + d * sine[c];
        j = d * cosine[c] - b * sine[c], k = e * cosine[c] + a * sine[c];
    }
    p[0] = px, p[1] = py, p[2] = pz;
    for (int c = 0; c < LANES; c++) {
        double rx = px - J[3][c], ry = py - J[4][c], rz = pz - J[5][c];
        J[3][c] = J[1][c] * rz - J[2][c] * ry;
        J[4][c] = J[2][c] * rx - J[0][c] * rz;
        J[5][c] = J[0][c] * ry - J[1][c] * rx;
    }
    px *= 0.5, py *= 0.5, pz *= 0.5;
    x[0] = w, x[1] = i, x[2] = j, x[3] = k;
    x[4] = -px * i - py * j - pz * k, x[5] = px * w + py * k - pz * j;
    x[6] = py * w + pz * i - px * k, x[7] = pz * w + px * j - py * i;
}

void expert_loop(const double *chain, int n, double *q, const double *samples, int width, int steps, double period,
                 double gain, double damping, double length, double *q_record, double *command_record)
{
    double x[8], p[3], J[6][LANES] = {{0}}, e[8], rate[8], w[3], v[3], t[6], A[6][6];
    double linear = damping * damping, angular = linear / (length * length);
    (void)n;
    for (int s = 0; s < steps; s++) {
        memcpy(q_record + (long)s * JOINTS, q, JOINTS * sizeof *q);
        hand_kinematics(chain, q, x, p, J);
        conjugate_product(x, samples + (long)s * width, e);
        double sign = e[0] >= 0 ? 1 : -1;
        UNROLL for (int c = 0; c < 8; c++)
            e[c] = sign * e[c], rate[c] = gain * e[c];
        rate[0] -= gain;
        nearest_twist(rate, e, w, v);
        rotate(x, w, t);
        rotate(x, v, t + 3);
        UNROLL for (int r = 0; r < 6; r++) {
            UNROLL for (int c = 0; c <= r; c++) {
                double sum = 0;
                UNROLL for (int k = 0; k < JOINTS; k++)
                    sum += J[r][k] * J[c][k];
                A[r][c] = sum;
            }
            A[r][r] += r < 3 ? angular : linear;
        }
        UNROLL for (int c = 0; c < 6; c++) { /* below the diagonal L, on it 1 / D */
            double scaled[6];
            UNROLL for (int k = 0; k < c; k++) {
                scaled[k] = A[c][k];
                A[c][k] *= A[k][k];
                A[c][c] -= scaled[k] * A[c][k];
            }
            A[c][c] = 1 / A[c][c];
            UNROLL for (int r = c + 1; r < 6; r++)
                UNROLL for (int k = 0; k < c; k++)
                    A[r][c] -= A[r][k] * A[c][k];
        }
        UNROLL for (int r = 1; r < 6; r++)
            UNROLL for (int k = 0; k < r; k++)
                t[r] -= A[r][k] * t[k];
        UNROLL for (int r = 0; r < 6; r++)
            t[r] *= A[r][r];
        UNROLL for (int r = 4; r >= 0; r--)
            UNROLL for (int k = r + 1; k < 6; k++)
                t[r] -= A[k][r] * t[k];
        double u[LANES];
        for (int c = 0; c < LANES; c++) {
            u[c] = 0;
            UNROLL for (int k = 0; k < 6; k++)
                u[c] += J[k][c] * t[k];
        }
        double *command = command_record + (long)s * JOINTS;
        for (int c = 0; c < JOINTS; c++) {
            command[c] = u[c];
            q[c] += period * u[c];
        }
    }
}
