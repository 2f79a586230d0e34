/* Poses with both Jacobians of COUNT configurations, as a process of its own: reads the chain and the configurations,
   says "ready", and on each byte that it gets computes all and says "done". */
#include "closed_loop.c"
#include <stdio.h>
#include <stdlib.h>

static void pose_jacobian(const double *x, double W[6][MOST], int n, double J[8][MOST])
{
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

int main(int argc, char **argv)
{
    int n = argc > 2 ? atoi(argv[1]) : 0;
    long count = argc > 2 ? atol(argv[2]) : 0, size = 8 + 14 * n;
    double *chain = malloc(8 * (n + 1) * sizeof *chain), *q = malloc(count * n * sizeof *q);
    double *out = malloc(count * size * sizeof *out);
    if (!chain || !q || !out || fread(chain, sizeof *chain, 8 * (n + 1), stdin) != 8 * (size_t)(n + 1) ||
        fread(q, sizeof *q, count * n, stdin) != (size_t)(count * n))
        return 1;
    memset(out, 0, count * size * sizeof *out);
    puts("ready");
    fflush(stdout);
    while (getchar() != EOF) {
        for (long i = 0; i < count; i++) {
            double x[8], p[3], J[8][MOST], W[6][MOST], *to = out + i * size;
            twist_kinematics(chain, q + i * n, n, x, p, W);
            pose_jacobian(x, W, n, J);
            memcpy(to, x, sizeof x);
            for (int r = 0; r < 8; r++)
                memcpy(to + 8 + r * n, J[r], n * sizeof *to);
            for (int r = 0; r < 6; r++)
                memcpy(to + 8 + (8 + r) * n, W[r], n * sizeof *to);
        }
        puts("done");
        fflush(stdout);
    }
    return 0;
}
