/* Fig. 2: -lap u = f on the unit square with u = sin(pi x) sin(pi y) on grids of 2^2 .. 64^2 squares: L2 errors and
   condition numbers of continuous bilinear elements and of BZ and IP with linear and quadratic polynomials.

   The paper prints |lap u + f| as the error; that is |u_h - u| here: for linear elements the former means nothing. */
#include "poisson.h"

static const double pi = 3.14159265358979323846;
static double wave(double x, double y) { return sin(pi * x) * sin(pi * y); }
static double source(double x, double y) { return 2 * pi * pi * wave(x, y); }
static double zero(double x, double y) { return (void)x, (void)y, 0; }

enum { METHODS = 5, LEVELS = 6 };

typedef struct method {
    const char *name;
    int degree, consistent; /* degree 0: continuous */
    double eta;
} method;

/* Penalties eta/h: IP with about three times its least stable value; BZ with the library's default for it, 20 p^2. */
static const method methods[METHODS] = {
    {"CG bilinear", 0, 0, 0}, {"BZ p=1", 1, 0, 20}, {"IP p=1", 1, 1, 4}, {"BZ p=2", 2, 0, 80}, {"IP p=2", 2, 1, 16}};

typedef struct result {
    int dofs;
    double error, raw, scaled;
} result;

static result solve_continuous(int n) {
    bilinear b;
    result r;
    memset(&b, 0, sizeof b);
    b.n = n, b.f = source, b.exact = wave;
    bilinear_solve(&b);
    r.dofs = b.matrix->size;
    r.error = bilinear_error(&b);
    r.raw = matrix_condition(b.matrix, 0);
    r.scaled = matrix_condition(b.matrix, 1);
    bilinear_free(&b);
    return r;
}

static result solve(const method *m, int n, double boundary, int conditions) {
    poisson p;
    result r;
    if (!m->degree) return solve_continuous(n);
    memset(&p, 0, sizeof p);
    p.n = n, p.degree = m->degree, p.consistent = m->consistent, p.eta = m->eta, p.boundary = boundary;
    p.f = source, p.g = zero, p.exact = wave;
    poisson_solve(&p);
    r.dofs = p.matrix->size;
    r.error = poisson_error(&p);
    r.raw = conditions ? matrix_condition(p.matrix, 0) : 0;
    r.scaled = conditions ? matrix_condition(p.matrix, 1) : 0;
    poisson_free(&p);
    return r;
}

/* Is the IP matrix on 4 x 4 squares positive definite? */
static int is_definite(int degree, double eta, double boundary) {
    poisson p;
    memset(&p, 0, sizeof p);
    p.n = 4, p.degree = degree, p.consistent = 1, p.eta = eta, p.boundary = boundary;
    p.f = p.g = p.exact = zero;
    poisson_assemble(&p);
    int definite = matrix_solve(p.matrix, p.rhs, p.x);
    poisson_free(&p);
    return definite;
}

static double least_eta(int degree, double boundary) {
    double low = 0, high = 32;
    while (high - low > 1e-3) {
        double middle = 0.5 * (low + high);
        if (is_definite(degree, middle, boundary)) high = middle;
        else low = middle;
    }
    return high;
}

static void print_levels(paper *out, const char *title, result (*r)[METHODS], int levels, int what) {
    paper_table(out, title, "squares|CG bilinear|BZ p=1|IP p=1|BZ p=2|IP p=2");
    for (int l = 0; l < levels; l++) {
        const result *a = r[l];
        if (what == 0)
            paper_row(out, "%d^2|%.3e|%.3e|%.3e|%.3e|%.3e", 2 << l, a[0].error, a[1].error, a[2].error, a[3].error,
                      a[4].error);
        else if (what == 1)
            paper_row(out, "%d^2|%.3g|%.3g|%.3g|%.3g|%.3g", 2 << l, a[0].raw, a[1].raw, a[2].raw, a[3].raw, a[4].raw);
        else if (what == 2)
            paper_row(out, "%d^2|%.3g|%.3g|%.3g|%.3g|%.3g", 2 << l, a[0].scaled, a[1].scaled, a[2].scaled, a[3].scaled,
                      a[4].scaled);
        else paper_row(out, "%d^2|%d|%d|%d|%d|%d", 2 << l, a[0].dofs, a[1].dofs, a[2].dofs, a[3].dofs, a[4].dofs);
    }
    for (int l = 1; l < levels && what == 0; l++)
        paper_row(out, "rate to %d^2|%.2f|%.2f|%.2f|%.2f|%.2f", 2 << l, paper_rate(r[l - 1][0].error, r[l][0].error, 2),
                  paper_rate(r[l - 1][1].error, r[l][1].error, 2), paper_rate(r[l - 1][2].error, r[l][2].error, 2),
                  paper_rate(r[l - 1][3].error, r[l][3].error, 2), paper_rate(r[l - 1][4].error, r[l][4].error, 2));
    paper_print(out);
}

/* Too much penalty hurts linear polynomials on squares: they cannot be continuous there. */
static void print_penalties(paper *out, double continuous) {
    static const double etas[] = {2, 4, 10, 40}, expected[] = {3.7e-3, 6.2e-3, 1.5e-2, 5.3e-2};
    paper_table(out, "IP p=1 on 16^2 squares: L2 error for growing penalty", "eta|ours|expected");
    for (int i = 0; i < 4; i++) {
        method m = methods[2];
        m.eta = etas[i];
        paper_row(out, "%g|%.2e|%.1e", etas[i], solve(&m, 16, 1, 0).error, expected[i]);
    }
    paper_row(out, "CG bilinear|%.2e|1.9e-3", continuous);
    paper_print(out);
}

static void print_comparison(paper *out, result (*r)[METHODS], int levels) {
    const result *a = r[levels - 2], *b = r[levels - 1];
    double least[2][2];
    for (int degree = 1; degree <= 2; degree++)
        for (int factor = 1; factor <= 2; factor++) least[degree - 1][factor - 1] = least_eta(degree, factor);
    paper_table(out, "Fig. 2 row by row", "quantity|ours|paper|expected");
    paper_row(out, "rate of CG bilinear|%.2f|(plot)|2", paper_rate(a[0].error, b[0].error, 2));
    paper_row(out, "rate of IP p=1|%.2f|similar to CG|2", paper_rate(a[2].error, b[2].error, 2));
    paper_row(out, "rate of IP p=2|%.2f|faster|3", paper_rate(a[4].error, b[4].error, 2));
    paper_row(out, "rate of BZ p=2|%.2f|no guarantee of convergence|0: the error stalls",
              paper_rate(a[3].error, b[3].error, 2));
    paper_row(out, "condition IP p=1 / CG, finest|%.1f|higher than CG's|-", b[2].raw / b[0].raw);
    paper_row(out, "condition IP p=2 / CG, finest|%.1f|higher than CG's|-", b[4].raw / b[0].raw);
    paper_row(out, "least eta of IP p=1, boundary factor 1 / 2|%.2f / %.2f|start low and double|1.27 / 0.95",
              least[0][0], least[0][1]);
    paper_row(out, "least eta of IP p=2, boundary factor 1 / 2|%.2f / %.2f|start low and double|4.30 / 2.92",
              least[1][0], least[1][1]);
    paper_print(out);
}

int main(int argc, char **argv) {
    program p = program_begin(argc, argv, "fig2 [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&p);
    result results[LEVELS][METHODS];
    int levels = out->quick ? 4 : LEVELS;
    for (int l = 0; l < levels; l++)
        for (int m = 0; m < METHODS; m++) results[l][m] = solve(&methods[m], 2 << l, 1, 1);
    print_levels(out, "L2 error (IP: eta = 4 p^2, BZ: eta = 20 p^2, divided by h)", results, levels, 0);
    print_levels(out, "Condition number of the matrix", results, levels, 1);
    print_levels(out, "Condition number after scaling by the diagonal", results, levels, 2);
    print_levels(out, "Unknowns", results, levels, 3);
    print_penalties(out, results[3][0].error);
    print_comparison(out, results, levels);
    paper_end(out);
    return 0;
}
