/* Fig. 1: consistency. -lap u = -2 with u = x^2 on the boundary of the unit square, quadratic polynomials on 4 x 4
   squares. The exact solution x^2 lies in the space: IP finds it for every penalty, BZ for none. */
#include "poisson.h"

static double minus_two(double x, double y) { return (void)x, (void)y, -2; }
static double square(double x, double y) { return (void)y, x * x; }

typedef struct result {
    double error, jump;
    int definite;
} result;

static result solve(int n, int consistent, double eta) {
    poisson p;
    result r;
    memset(&p, 0, sizeof p);
    p.n = n, p.degree = 2, p.consistent = consistent, p.eta = eta, p.boundary = 1;
    p.f = minus_two, p.g = square, p.exact = square;
    r.definite = poisson_solve(&p);
    r.error = poisson_error(&p);
    r.jump = poisson_jump(&p);
    poisson_free(&p);
    return r;
}

int main(int argc, char **argv) {
    static const double etas[] = {0.5, 1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 4096};
    program p = program_begin(argc, argv, "fig1 [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&p);
    double worst = 0, scaled = 0;
    paper_table(out, "L2 error and jump on 4 x 4 squares, p = 2",
                "eta|BZ error|BZ error * eta|BZ jump (rms)|IP error|IP jump (rms)|IP matrix");
    for (size_t i = 0; i < sizeof etas / sizeof *etas; i++) {
        result bz = solve(4, 0, etas[i]), ip = solve(4, 1, etas[i]);
        paper_row(out, "%g|%.3e|%.3f|%.2e|%.1e|%.1e|%s", etas[i], bz.error, bz.error * etas[i], bz.jump, ip.error,
                  ip.jump,
                  ip.definite == 1   ? "definite"
                  : ip.definite == 0 ? "indefinite"
                                     : "singular");
        if (ip.definite >= 0 && ip.error > worst) worst = ip.error;
        scaled = bz.error * etas[i];
    }
    paper_print(out);
    paper_table(out, "BZ does not converge: L2 error under refinement, p = 2", "squares|eta 10|eta 100|IP, eta 10");
    for (int n = 2; n <= (out->quick ? 8 : 32); n *= 2)
        paper_row(out, "%d^2|%.3e|%.3e|%.1e", n, solve(n, 0, 10).error, solve(n, 0, 100).error, solve(n, 1, 10).error);
    paper_print(out);
    paper_table(out, "Fig. 1 row by row", "quantity|ours|paper|expected");
    paper_row(out, "IP: largest L2 error over all penalties|%.1e|exact, independent of eta|exact for every eta", worst);
    paper_row(out, "BZ: L2 error times eta, eta large|%.3f|not exact; falls as eta grows|0.19", scaled);
    paper_print(out);
    paper_end(out);
    return 0;
}
