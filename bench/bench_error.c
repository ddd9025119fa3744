/* Time against error: a bar of 1 x 0.25 x 0.25 m, held at x = 0, under its own weight, by polynomials of degree 1, 2
   and 3 on hexahedra and by continuous linear tetrahedra (six to a cube; dgfem_mvc.h, which is just that there).

       bench_error [--quick] [--large] [--markdown] [--csv FILE]

   The error is that of the linear static tip, relative to a bar of degree 3 on boxes graded towards the held face's
   edges. Poisson's ratio is 0, where the solution is smooth, and 0.3, where the held face's edges are singular and slow
   all methods down alike. "solve" is the time of assembly, factorization and solution, least of three; "step" that of a
   time step of 1/60 s, median of ten, by whichever solver was the fastest. Times are of the processor. The tables go
   to build/bench/error.csv as well. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"

#include "../examples/paper/paper.h"
#include "bench.h"
#include "solvers.h"

enum { STEPS = 10 };

static const double length = 1, width = 0.25;

typedef struct point {
    int unknowns;
    double tip, solve, step; /* m, s, s */
    const char *fastest;
} point;

/* A step so much longer than another solver's median ends the trial; the first ones often prepare for later ones. */
static int is_hopeless(const point *p, int i, double time) { return i > 0 && p->fastest && time > 3 * p->step; }

static void keep_fastest(point *p, const char *name, const double *times) {
    double time = median(times, STEPS);
    if (p->fastest && !(time < p->step)) return;
    p->fastest = name;
    p->step = time;
}

/* ---- discontinuous elements ---- */

static dgfem_mesh *hexahedra(int n) { return grid_mesh(vec3(0, 0, 0), vec3(length, width, width), 4 * n, n, n); }

static dgfem_body *solid(dgfem_mesh *mesh, double poisson, int degree, int warp, dgfem_solver solver) {
    dgfem_body_desc desc = linear_desc(1e5, poisson);
    desc.material.density = 1000;
    desc.gravity = vec3(0, 0, -9.81);
    desc.degree = degree;
    desc.warp = warp;
    desc.solver = solver;
    dgfem_body *body = body_of(desc, mesh);
    hold_plane(body, plane(1, 0, 0, 0));
    return body;
}

static double solid_tip(dgfem_body *body) {
    if (!solve_linear(body, NULL)) need(DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "bar");
    return mean_on(body, plane(1, 0, 0, length)).z;
}

/* Degree 3 on 8 x 2 x 2 boxes, those along the held face and the sides halved so many times. */
static double graded_tip(double poisson, int halvings) {
    dgfem_mesh *mesh = grid_mesh(vec3(0, 0, 0), vec3(length, width, width), 8, 2, 2);
    for (double h = width / 4; halvings > 0; h /= 2, halvings--) {
        const dgfem_plane cuts[5] = {plane(1, 0, 0, h), plane(0, 1, 0, h), plane(0, 1, 0, width - h), plane(0, 0, 1, h),
                                     plane(0, 0, 1, width - h)};
        for (int k = 0; k < 5; k++) need(dgfem_mesh_split_plane(mesh, cuts[k], 0, NULL), "split");
    }
    dgfem_body *body = solid(mesh, poisson, 3, 0, DGFEM_SOLVER_CHOLESKY);
    double tip = solid_tip(body);
    dgfem_body_destroy(body);
    return tip;
}

static void solid_steps(int n, double poisson, int degree, const solver_case *solver, point *p) {
    dgfem_body *body = solid(hexahedra(n), poisson, degree, 1, solver->solver);
    double times[STEPS];
    int hopeless = 0;
    for (int i = 0; i < STEPS && !hopeless; i++) {
        double start = cpu_seconds(NULL);
        need(dgfem_body_step(body, 1.0 / 60, NULL), "step");
        times[i] = cpu_seconds(NULL) - start;
        hopeless = is_hopeless(p, i, times[i]);
    }
    if (!hopeless) keep_fastest(p, solver->name, times);
    dgfem_body_destroy(body);
}

static point solid_point(int n, double poisson, int degree) {
    point p;
    memset(&p, 0, sizeof p);
    dgfem_body *body = solid(hexahedra(n), poisson, degree, 0, DGFEM_SOLVER_CHOLESKY);
    p.unknowns = 3 * body->basis_count;
    p.tip = solid_tip(body);
    p.solve = 1e300;
    for (int i = 0; i < 3; i++) {
        dgfem_step_info info;
        (void)solve_linear(body, &info);
        p.solve = fmin(p.solve, info.seconds_assemble + info.seconds_factor + info.seconds_solve);
    }
    dgfem_body_destroy(body);
    for (int k = 0; k < SOLVERS; k++) solid_steps(n, poisson, degree, &solvers[k], &p);
    return p;
}

/* ---- continuous tetrahedra ---- */

static dgfem_mvc *tetrahedra(int n, double poisson, int warp, dgfem_solver solver) {
    kuhn k = kuhn_create(vec3(0, 0, 0), vec3(length, width, width), 4 * n, n, n);
    dgfem_mesh *mesh = kuhn_mesh(&k);
    dgfem_mvc_desc desc = dgfem_default_mvc_desc();
    dgfem_mvc *body;
    desc.mesh = mesh;
    desc.material.young = 1e5, desc.material.poisson = poisson, desc.material.density = 1000;
    desc.warp = warp;
    desc.solver = solver;
    desc.hooks = paper_hooks();
    need(dgfem_mvc_create(&desc, &body), "tetrahedra");
    dgfem_mesh_destroy(mesh);
    kuhn_free(&k);
    int count = dgfem_mvc_nodes_on_plane(body, plane(1, 0, 0, 0), 1e-9, NULL, 0);
    int *nodes = (int *)need_memory((size_t)count, sizeof *nodes);
    (void)dgfem_mvc_nodes_on_plane(body, plane(1, 0, 0, 0), 1e-9, nodes, count);
    need(dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, vec3(0, 0, 0), NULL), "fix_nodes");
    free(nodes);
    return body;
}

/* Mean over the end face, whose triangles are all of one size. */
static double tetrahedra_tip(const dgfem_mvc *body) {
    int count = dgfem_mvc_faces_on_plane(body, plane(1, 0, 0, length), 1e-9, NULL, 0), nodes[3];
    int *faces = (int *)need_memory((size_t)count, sizeof *faces);
    double sum = 0;
    (void)dgfem_mvc_faces_on_plane(body, plane(1, 0, 0, length), 1e-9, faces, count);
    for (int i = 0; i < count; i++) {
        expect(dgfem_mvc_face_nodes(body, faces[i], nodes, 3) == 3, "a triangle");
        for (int k = 0; k < 3; k++) sum += body->position[nodes[k]].z - body->rest[nodes[k]].z;
    }
    free(faces);
    return sum / (3 * count);
}

static void tetrahedra_steps(int n, double poisson, dgfem_solver solver, const char *name, point *p) {
    dgfem_mvc *body = tetrahedra(n, poisson, 1, solver);
    double times[STEPS];
    int hopeless = 0;
    for (int i = 0; i < STEPS && !hopeless; i++) {
        double start = cpu_seconds(NULL);
        need(dgfem_mvc_step(body, 1.0 / 60, NULL), "step");
        times[i] = cpu_seconds(NULL) - start;
        hopeless = is_hopeless(p, i, times[i]);
    }
    if (!hopeless) keep_fastest(p, name, times);
    dgfem_mvc_destroy(body);
}

static point tetrahedra_point(int n, double poisson) {
    point p;
    memset(&p, 0, sizeof p);
    dgfem_mvc *body = tetrahedra(n, poisson, 0, DGFEM_SOLVER_CHOLESKY);
    p.unknowns = 3 * body->node_count;
    p.solve = 1e300;
    for (int i = 0; i < 3; i++) {
        dgfem_mvc_info info;
        need(dgfem_mvc_solve_static(body, NULL, &info), "static solve");
        p.solve = fmin(p.solve, info.seconds_assemble + info.seconds_factor + info.seconds_solve);
    }
    p.tip = tetrahedra_tip(body);
    dgfem_mvc_destroy(body);
    tetrahedra_steps(n, poisson, DGFEM_SOLVER_CHOLESKY, "cholesky", &p);
    tetrahedra_steps(n, poisson, DGFEM_SOLVER_PCG, "pcg", &p);
    return p;
}

/* ---- tables ---- */

static void print_curve(paper *out, const char *method, double poisson, int degree, const int *sizes,
                        double reference) {
    char title[100];
    snprintf(title, sizeof title, "%s, Poisson's ratio %.1f", method, poisson);
    paper_table(out, title, "cells|unknowns|tip (m)|error|solve (ms)|step (ms)|by");
    for (; *sizes; sizes++) {
        int n = *sizes;
        point p = degree ? solid_point(n, poisson, degree) : tetrahedra_point(n, poisson);
        paper_row(out, "%d x %d x %d|%d|%.5f|%.6f|%.3f|%.3f|%s", 4 * n, n, n, p.unknowns, p.tip,
                  fabs(p.tip / reference - 1), 1e3 * p.solve, 1e3 * p.step, p.fastest);
    }
    paper_print(out);
    fflush(stdout);
}

static void bench_bar(paper *out, double poisson, int large) {
    static const int all[3][4][8] = {
        {{2, 4, 8, 12, 0}, {1, 2, 3, 4, 6, 8, 0}, {1, 2, 3, 4, 5, 0}, {1, 2, 3, 4, 0}},
        {{2, 4, 8, 0}, {1, 2, 3, 4, 0}, {1, 2, 3, 0}, {1, 2, 0}},
        {{2, 4, 8, 12, 16, 0}, {1, 2, 3, 4, 6, 8, 10, 0}, {1, 2, 3, 4, 5, 6, 0}, {1, 2, 3, 4, 5, 0}}};
    const int(*sizes)[8] = all[large ? 2 : out->quick];
    int halvings = out->quick ? 2 : 4;
    double coarser = graded_tip(poisson, halvings - 1), reference = graded_tip(poisson, halvings);
    printf("\nBar held on one side, Poisson's ratio %.1f: reference tip %.6f m; with one halving less %.6f (%.1e)\n",
           poisson, reference, coarser, fabs(coarser / reference - 1));
    print_curve(out, "Degree 1", poisson, 1, sizes[1], reference);
    print_curve(out, "Degree 2", poisson, 2, sizes[2], reference);
    print_curve(out, "Degree 3", poisson, 3, sizes[3], reference);
    print_curve(out, "Continuous linear tetrahedra", poisson, 0, sizes[0], reference);
}

int main(int argc, char **argv) {
    program options = program_begin(argc, argv, "bench_error [--quick] [--large] [--markdown] [--csv FILE]");
    int large = program_flag(&options, "--large");
    paper *out = paper_begin(&options);
    if (!out->csv) out->csv = fopen("build/bench/error.csv", "w");
    bench_bar(out, 0, large);
    bench_bar(out, 0.3, large);
    paper_end(out);
    return 0;
}
