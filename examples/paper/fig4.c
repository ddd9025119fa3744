/* Fig. 4: integration over a polyhedron. The cube 0..2 without the corner (2,2,2), cut off through the middles of its
   edges: the moments of dgfem_polyhedron_moments against sub-tetrahedra with Gauss points, voxels and random points.
   The paper integrates x^2; x^2 y^2 z^2 is beside it because x^2 is easy for Gauss points.

   Exact values: 203/20 for x^2. For x^2 y^2 z^2 the cube gives (8/3)^3 and the corner tetrahedron, with (2-r)(2-s)(2-t)
   for xyz and int r^a s^b t^c = a! b! c! / (a+b+c+3)! over r + s + t <= 1, the polynomial that main() sums in integers.
   */
#include "paper.h"

typedef struct estimate {
    double first, second, seconds; /* of x^2, of x^2 y^2 z^2, for one pass */
    long points;
} estimate;

typedef struct sums {
    double first, second;
    long points;
} sums;

static void sample(void *user, dgfem_vec3 x, double weight) {
    sums *s = (sums *)user;
    s->first += weight * x.x * x.x;
    s->second += weight * x.x * x.x * x.y * x.y * x.z * x.z;
    s->points++;
}

static dgfem_polyhedron *cut_cube(void) {
    static const dgfem_vec3 vertices[10] = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}, {0, 0, 2},
                                            {2, 0, 2}, {0, 2, 2}, {2, 2, 1}, {1, 2, 2}, {2, 1, 2}};
    static const int start[8] = {0, 4, 8, 12, 17, 22, 27, 30};
    static const int loops[30] = {0, 3, 2, 1, 0, 1, 5, 4, 0, 4, 6, 3, 1, 2, 7,
                                  9, 5, 2, 3, 6, 8, 7, 4, 5, 9, 8, 6, 7, 8, 9};
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfem_polyhedron *p;
    desc.vertices = vertices, desc.vertex_count = 10;
    desc.face_count = 7, desc.loop_start = start, desc.loop_vertices = loops;
    desc.hooks = paper_hooks();
    need(dgfem_polyhedron_create(&desc, &p), "cut cube");
    return p;
}

/* ---- the methods: each fills in `out` once ---- */

typedef void (*method_fn)(const dgfem_polyhedron *p, int n, estimate *out);

static void by_moments(const dgfem_polyhedron *p, int degree, estimate *out) {
    double m[84];
    need(dgfem_polyhedron_moments(p, degree, vec3(0, 0, 0), m), "moments");
    out->first = m[dgfem_monomial_index(2, 0, 0)];
    out->second = degree >= 6 ? m[dgfem_monomial_index(2, 2, 2)] : (double)NAN;
    out->points = 0;
}

static void by_gauss(const dgfem_polyhedron *p, int n, estimate *out) {
    sums s;
    memset(&s, 0, sizeof s);
    quadrature_polyhedron(p, n, sample, &s);
    out->first = s.first, out->second = s.second, out->points = s.points;
}

/* Inside the cube and below x + y + z = 5: an easy test, which flatters the two that need it. */
static int is_inside(dgfem_vec3 x) { return x.x + x.y + x.z <= 5; }

static void by_voxels(const dgfem_polyhedron *p, int n, estimate *out) {
    double h = 2.0 / n;
    sums s;
    (void)p;
    memset(&s, 0, sizeof s);
    for (int i = 0; i < n * n * n; i++) {
        dgfem_vec3 x = vec3((i % n + 0.5) * h, (i / n % n + 0.5) * h, (i / (n * n) + 0.5) * h);
        if (is_inside(x)) sample(&s, x, h * h * h);
    }
    out->first = s.first, out->second = s.second, out->points = (long)n * n * n;
}

static void by_chance(const dgfem_polyhedron *p, int n, estimate *out) {
    unsigned long long state = 20090101;
    sums s;
    (void)p;
    memset(&s, 0, sizeof s);
    for (int i = 0; i < n; i++) {
        double x = 2 * random_number(&state), y = 2 * random_number(&state), z = 2 * random_number(&state);
        if (is_inside(vec3(x, y, z))) sample(&s, vec3(x, y, z), 8.0 / n);
    }
    out->first = s.first, out->second = s.second, out->points = n;
}

/* Repeats until a measurable time has passed; seconds are of one pass. */
static estimate measure(const dgfem_polyhedron *p, method_fn method, int n) {
    estimate e;
    double start = cpu_seconds(NULL), passed = 0;
    long passes = 0, batch = 1;
    memset(&e, 0, sizeof e);
    while (passed < 0.02) {
        for (long i = 0; i < batch; i++) method(p, n, &e);
        passes += batch;
        batch *= 2;
        passed = cpu_seconds(NULL) - start;
    }
    e.seconds = passed / (double)passes;
    return e;
}

/* int x^2 y^2 z^2 over the cut cube: (8/3)^3 less the corner, in ninths of factorials. */
static double exact_second(void) {
    static const double binomial[3] = {4, -4, 1}; /* (2 - r)^2 */
    static const double factorial[10] = {1, 1, 2, 6, 24, 120, 720, 5040, 40320, 362880};
    double corner = 0;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            for (int c = 0; c < 3; c++) /* times 9!: all terms are whole numbers */
                corner += binomial[a] * binomial[b] * binomial[c] * factorial[a] * factorial[b] * factorial[c] *
                          (factorial[9] / factorial[a + b + c + 3]);
    return 512.0 / 27 - corner / factorial[9];
}

static const double exact_first = 203.0 / 20;

static void print_row(paper *out, const char *name, int n, const estimate *e) {
    char second[32];
    snprintf(second, sizeof second, isnan(e->second) ? "-" : "%.1e", fabs(e->second / exact_second() - 1));
    paper_row(out, "%s %d|%ld|%.2f|%.1e|%s", name, n, e->points, 1e6 * e->seconds, fabs(e->first / exact_first - 1),
              second);
}

int main(int argc, char **argv) {
    program options = program_begin(argc, argv, "fig4 [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&options);
    dgfem_polyhedron *p = cut_cube();
    estimate e, best = measure(p, by_moments, 2), same_time;
    memset(&same_time, 0, sizeof same_time);
    paper_table(out, "Corner-cut cube: relative errors and time",
                "method|points|microseconds|error of x^2|error of x^2 y^2 z^2");
    print_row(out, "all moments up to degree", 2, &best);
    e = measure(p, by_moments, 6), print_row(out, "all moments up to degree", 6, &e);
    paper_print(out);
    paper_table(out, "Gauss points on sub-tetrahedra (n^3 each)",
                "n|points|microseconds|error of x^2|error of x^2 y^2 z^2");
    for (int n = 1; n <= 6; n++) e = measure(p, by_gauss, n), print_row(out, "", n, &e);
    paper_print(out);
    paper_table(out, "Voxels (n^3)", "n|points|microseconds|error of x^2|error of x^2 y^2 z^2");
    for (int n = 2; n <= (out->quick ? 32 : 128); n *= 2) {
        e = measure(p, by_voxels, n), print_row(out, "", n, &e);
        if (e.seconds <= best.seconds || n == 2) same_time = e;
    }
    paper_print(out);
    paper_table(out, "Random points", "n|points|microseconds|error of x^2|error of x^2 y^2 z^2");
    for (int n = 10; n <= (out->quick ? 10000 : 1000000); n *= 10)
        e = measure(p, by_chance, n), print_row(out, "", n, &e);
    paper_print(out);
    paper_table(out, "Fig. 4 row by row", "quantity|ours|paper|exact");
    paper_row(out, "integral of x^2|%.15g|exact up to round-off|203/20", best.first);
    paper_row(out, "its relative error|%.1e|exact up to round-off|0", fabs(best.first / exact_first - 1));
    paper_row(out, "error of voxels in the same time|%.0e|about 1e-2 for numerical integration|-",
              fabs(same_time.first / exact_first - 1));
    paper_print(out);
    dgfem_polyhedron_destroy(p);
    paper_end(out);
    return 0;
}
