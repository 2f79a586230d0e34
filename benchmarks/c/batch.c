/* Poses with both Jacobians of COUNT configurations, as a process of its own: reads the chain and the configurations,
   says "ready", and on each byte that it gets computes all and says "done". */
#include "closed_loop.c"
#include <stdio.h>
#include <stdlib.h>

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
            double x[8], J[8][MOST], W[6][MOST], *to = out + i * size;
            pose_and_jacobians(chain, q + i * n, n, x, J, W);
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
