/* The time step, solver by solver: a hanging bar beside published engines and beside CHOLMOD and Eigen on the same
   matrix in the same run, soft bodies that fall on a floor in real time, and the allocations inside of a step.

       bench_step [--quick] [--cpu] [--solver NAME] [--only bar|real-time] [--csv FILE]

   All trajectories are run several times, in turns; of each step the least time counts, and what is printed is the
   median, the mean, the 95th percentile and the largest of those of all steps, the slowest step that was seen in any
   run, and the means of the phases. --cpu counts the processor's time in place of the wall's, for machines that others
   use at the same time. --quick takes fewer runs and leaves out Eigen on the larger bars and the demo's own bunny. The
   bars' figures go to build/bench/step_double.csv (or _float) as well.

   The tip's error is the largest distance, at any time, of the end face's mean displacement from that of the direct
   solver in double, over the bar's length and over how far the tip has moved. Allocations are those after the first
   step. CHOLMOD and Eigen work in double; a step of theirs is our assembly and their factorization and solve, and the
   ratio is that of the means. OMP_THREAD_LIMIT=1 and OPENBLAS_NUM_THREADS=1 keep CHOLMOD to one thread. Whether the aim
   is reached is told of the median. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "bench.h"
#include "box.h"
#include "model.h"
#include "peers.h"
#include "program.h"
#include "reference.h"
#include "solvers.h"

enum { MAX_STEPS = 240, BAR_STEPS = 60 };

typedef struct options {
    int quick, runs;
    const char *solver;
    FILE *csv;
} options;

/* ---- runs ---- */

/* Seconds of each step, of whichever run was the fastest there. */
typedef struct trajectory {
    int steps, runs, failed;
    int elements, unknowns;
    double all[MAX_STEPS], assemble[MAX_STEPS], contact[MAX_STEPS], factor[MAX_STEPS], solve[MAX_STEPS];
    double slowest, iterations; /* of all runs; mean over the steps */
    int factorizations, most_contacts;
    long allocations; /* after the first step */
    double tip[BAR_STEPS][3];
} trajectory;

typedef struct scene {
    double dt;
    int steps;
    int is_bar;
    dgfem_body *(*create)(const void *user, const solver_case *solver, dgfem_hooks hooks);
    const void *user;
} scene;

static void record_step(trajectory *t, int i, double time, const dgfem_step_info *info) {
    t->slowest = fmax(t->slowest, time);
    if (t->runs > 0 && !(time < t->all[i])) return;
    t->all[i] = time;
    t->assemble[i] = info->seconds_assemble, t->contact[i] = info->seconds_contact;
    t->factor[i] = info->seconds_factor, t->solve[i] = info->seconds_solve;
}

/* Sets t->failed where the solver fails; the library has said why. */
static void run(const scene *s, const solver_case *solver, trajectory *t) {
    counted memory;
    memset(&memory, 0, sizeof memory);
    dgfem_body *body = s->create(s->user, solver, bench_hooks(&memory));
    long before = 0;
    t->steps = s->steps, t->iterations = 0, t->factorizations = 0;
    t->elements = body->mesh->element_count, t->unknowns = 3 * body->basis_count;
    for (int i = 0; !t->failed && i < s->steps; i++) {
        dgfem_step_info info;
        double start = seconds();
        t->failed = dgfem_body_step(body, (dgfem_real)s->dt, &info) != DGFEM_OK;
        record_step(t, i, seconds() - start, &info);
        if (i == 0) before = memory.calls;
        t->iterations += (double)info.iterations / s->steps;
        t->factorizations += info.factorizations;
        if (info.contacts > t->most_contacts) t->most_contacts = info.contacts;
        if (s->is_bar) box_tip(body, 1, t->tip[i]);
    }
    t->allocations = memory.calls - before;
    t->runs++;
    dgfem_body_destroy(body);
}

/* All solvers that are wanted, in turns; the others have 0 runs. */
static trajectory *run_all(const scene *s, const options *o) {
    trajectory *all = (trajectory *)room(SOLVERS, sizeof *all);
    for (int r = 0; r < o->runs; r++)
        for (int k = 0; k < SOLVERS; k++)
            if (is_wanted(&solvers[k], o->solver) && !all[k].failed) run(s, &solvers[k], &all[k]);
    return all;
}

/* 1 where there is a row to print; says so where the solver failed. */
static int has_run(const trajectory *t, const char *name) {
    if (t->failed) printf("  %-12s failed\n", name);
    return t->runs > 0 && !t->failed;
}

/* ---- the hanging bar ---- */

typedef struct bar_case {
    int cells[3];
    double float_aim, double_aim;                       /* median ms to stay below */
    double femfx, femfx_converged, cg, vegafem, bullet; /* ms per step */
} bar_case;

/* The engines' figures are published ones, of another machine, at 1,050, 4,032 and 11,979 unknowns. */
static const bar_case bars[3] = {
    {{22, 2, 2}, 0.8, 1.6, 0.79, 0.81, 1.6, 2.2, 6.8},
    {{21, 4, 4}, 3.6, 9.3, 3.6, 4.7, 9.3, 15.8, 42},
    {{28, 6, 6}, 14, 28, 13.9, 24.2, 42, 71, 161},
};

static dgfem_body *create_bar(const void *user, const solver_case *solver, dgfem_hooks hooks) {
    box b = bar_of((const int *)user, solver->solver);
    b.hooks = hooks;
    return box_body(&b);
}

static double distance(const double *a, const double *b) {
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

/* Largest error over the bar's length, and over the tip's way. */
static void tip_errors(const trajectory *t, double (*reference)[3], double errors[2]) {
    const double rest[3] = {0, 0, 0};
    errors[0] = errors[1] = 0;
    for (int i = 0; i < t->steps; i++) {
        double error = distance(t->tip[i], reference[i]), relative = error / distance(reference[i], rest);
        if (!(error <= errors[0])) errors[0] = error;
        if (!(relative <= errors[1])) errors[1] = relative;
    }
}

/* What other solvers take for the same matrix; count is 0 for those that are not there. */
typedef struct peers {
    const char *setting;
    figures cholmod, eigen;
} peers;

static void time_peers(const bar_case *bar, const options *o, peers *out) {
    const solver_case pcg = {"pcg", DGFEM_SOLVER_PCG}; /* keeps the matrix that it solves */
    dgfem_body *body = create_bar(bar->cells, &pcg, bench_hooks(NULL));
    expect(dgfem_body_step(body, DGFEM_R(1) / 60, NULL) == DGFEM_OK, "dgfem_body_step");
    const dgfem_matrix *matrix = body->matrix;
    dgfem_real *b = (dgfem_real *)room((size_t)matrix->size, sizeof *b);
    dgfem_real *x = (dgfem_real *)room((size_t)matrix->size, sizeof *x);
    for (int i = 0; i < matrix->size; i++) b[i] = noise();
    memset(out, 0, sizeof *out);
#ifdef HAVE_CHOLMOD
    cholmod_common common;
    cholmod_start(&common);
    cholmod_sparse *a = to_cholmod(matrix, &common);
    setting best = best_setting(matrix, a, b, x, &common);
    out->setting = setting_names[best];
    for (int r = 0; r < 3 * o->runs; r++) run_cholmod(matrix, a, best, NULL, b, x, &out->cholmod, &common);
    cholmod_free_sparse(&a, &common);
    cholmod_finish(&common);
#endif
#ifdef HAVE_EIGEN
    if (!o->quick || matrix->size < 5000) run_eigen(matrix, b, x, &out->eigen);
#endif
    (void)o;
    free(b);
    free(x);
    dgfem_body_destroy(body);
}

static double factor_and_solve(const figures *f) { return least(f->factor, f->count) + least(f->solve, f->count); }

static void print_bar_row(const bar_case *bar, const char *name, const trajectory *t, const double *errors,
                          double cholmod_step, const options *o) {
    double middle = 1e3 * median(t->all, t->steps), average = 1e3 * mean(t->all, t->steps);
    double high = 1e3 * percentile(t->all, t->steps, 0.95), largest = 1e3 * most(t->all, t->steps);
    double assemble = 1e3 * mean(t->assemble, t->steps), factor = 1e3 * mean(t->factor, t->steps);
    double solve = 1e3 * mean(t->solve, t->steps), aim = DGFEM_REAL_IS_FLOAT ? bar->float_aim : bar->double_aim;
    printf("  %-12s %8.2f %8.2f %8.2f %8.2f %8.2f %9.2f %8.2f %8.2f %7.1f %5d %10.1e %10.1e %6ld", name, middle,
           average, high, largest, 1e3 * t->slowest, assemble, factor, solve, t->iterations, t->factorizations,
           errors[0], errors[1], t->allocations);
    if (cholmod_step > 0) printf(" %7.2f", average / cholmod_step);
    printf("  %s\n", !(errors[1] < 0.01) ? "not within 1 %" : middle < aim ? "reached" : "too slow");
    if (o->csv)
        fprintf(o->csv, "%s,%d,%s,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%d,%.6g,%.6g\n", real_name(),
                12 * bar->cells[0] * bar->cells[1] * bar->cells[2], name, middle, average, high, largest, assemble,
                factor, solve, t->iterations, t->factorizations, errors[0], errors[1]);
}

static void print_peer_row(const char *name, const figures *f, double assemble, double cholmod_step) {
    double factor = 1e3 * least(f->factor, f->count), solve = 1e3 * least(f->solve, f->count);
    printf("  %-12s %17.2f %35.2f %8.2f %8.2f", name, assemble + factor + solve, assemble, factor, solve);
    printf(cholmod_step > 0 ? " %50.2f\n" : "\n", (assemble + factor + solve) / cholmod_step);
}

static void bench_bar(const bar_case *bar, const options *o) {
    double reference[BAR_STEPS][3], errors[2], assemble = 0, cholmod_step = 0;
    const scene s = {1.0 / 60, BAR_STEPS, 1, create_bar, bar->cells};
    peers other;
    reference_tip(bar->cells, BAR_STEPS, reference);
    trajectory *all = run_all(&s, o);
    time_peers(bar, o, &other);
    for (int k = SOLVERS - 1; k >= 0; k--)
        if (all[k].runs && !all[k].failed) assemble = 1e3 * mean(all[k].assemble, all[k].steps);
    if (other.cholmod.count) cholmod_step = assemble + 1e3 * factor_and_solve(&other.cholmod);
    printf("\nHanging bar of %d x %d x %d hexahedra, %d unknowns, %s: ms per step; of each of %d steps the least of %d "
           "runs\n",
           bar->cells[0], bar->cells[1], bar->cells[2], 12 * bar->cells[0] * bar->cells[1] * bar->cells[2], real_name(),
           BAR_STEPS, o->runs);
    printf("  %-12s %8s %8s %8s %8s %8s %9s %8s %8s %7s %5s %10s %10s %6s %s\n", "solver", "median", "mean", "95 %",
           "largest", "slowest", "assemble", "factor", "solve", "iterat.", "fact.", "tip/length", "tip/way", "alloc.",
           cholmod_step > 0 ? "ratio to CHOLMOD" : "");
    for (int k = 0; k < SOLVERS; k++) {
        if (!has_run(&all[k], solvers[k].name)) continue;
        tip_errors(&all[k], reference, errors);
        print_bar_row(bar, solvers[k].name, &all[k], errors, cholmod_step, o);
    }
    if (other.cholmod.count) print_peer_row("CHOLMOD", &other.cholmod, assemble, cholmod_step);
    if (other.eigen.count) print_peer_row("Eigen", &other.eigen, assemble, cholmod_step);
    if (other.cholmod.count)
        printf("  CHOLMOD's best order here: %s%s\n", other.setting,
               getenv("OMP_THREAD_LIMIT") && getenv("OPENBLAS_NUM_THREADS") ? "" : "; with several threads");
    printf("  published, on another machine: AMD FEMFX %.2f (float; converged %.2f), CG tetrahedra %.1f, VegaFEM %.1f, "
           "Bullet %.1f; to reach: below %.1f\n",
           bar->femfx, bar->femfx_converged, bar->cg, bar->vegafem, bar->bullet,
           DGFEM_REAL_IS_FLOAT ? bar->float_aim : bar->double_aim);
    fflush(stdout);
    free(all);
}

/* ---- real time ---- */

static void add_floor(dgfem_body *body, double height) {
    dgfem_shape_desc floor = dgfem_default_shape_desc();
    floor.plane.offset = (dgfem_real)height;
    expect(dgfem_body_add_plane(body, &floor, NULL) == DGFEM_OK, "dgfem_body_add_plane");
}

/* 12,000 unknowns, a metre each way, let go 0.1 m above the floor and a little askew. */
static dgfem_body *create_cube(const void *user, const solver_case *solver, dgfem_hooks hooks) {
    static const int cells[3] = {10, 10, 10};
    const dgfem_mat3 turn = {{{0, 0, DGFEM_R(0.1)}, {0, 0, 0}, {DGFEM_R(-0.1), 0, 0}}};
    const dgfem_vec3 none = {0, 0, 0};
    box b = box_of(1, 1, 1, cells, solver->solver);
    (void)user;
    b.hooks = hooks;
    dgfem_body *body = box_free_body(&b);
    add_floor(body, -0.2);
    expect(dgfem_body_set_affine(body, turn, none) == DGFEM_OK, "dgfem_body_set_affine");
    return body;
}

/* The demo's bunny, with or without its slivers; its skin's vertices touch; let go 0.3 m above the floor. */
typedef struct bunny {
    const formats_surface *surface;
    int keep_slivers;
} bunny;

static dgfem_body *create_bunny(const void *user, const solver_case *solver, dgfem_hooks hooks) {
    const bunny *which = (const bunny *)user;
    const formats_surface *surface = which->surface;
    dgfem_slice_desc slice = dgfem_default_slice_desc();
    dgfem_body_desc desc = dgfem_default_body_desc();
    dgfem_body *body = NULL;
    slice.vertices = dgfem_points_in_double(surface->vertices, surface->vertex_count);
    slice.triangles = surface->triangles;
    slice.triangle_count = surface->triangle_count;
    slice.cells = 11;
    if (which->keep_slivers) slice.sliver = 0;
    expect(dgfem_mesh_create_slices(&slice, &desc.mesh) == DGFEM_OK, "dgfem_mesh_create_slices");
    desc.material.young = DGFEM_R(4e5);
    desc.material.poisson = DGFEM_R(0.4);
    desc.eta_rest = DGFEM_R(0.7);
    desc.damping_stiffness = DGFEM_R(0.02);
    desc.damping_mass = 1;
    desc.solver = solver->solver;
    desc.hooks = hooks;
    expect(dgfem_body_create(&desc, &body) == DGFEM_OK, "dgfem_body_create");
    dgfem_real *areas = (dgfem_real *)room((size_t)surface->vertex_count, sizeof *areas);
    model_vertex_areas(surface, areas);
    expect(dgfem_body_set_contact_points(body, slice.vertices, areas) == DGFEM_OK, "dgfem_body_set_contact_points");
    free(areas);
    add_floor(body, -0.3);
    return body;
}

static void bench_real_time(const char *title, const scene *s, const options *o) {
    trajectory *all = run_all(s, o), *any = all;
    while (any < all + SOLVERS - 1 && !any->runs) any++;
    printf("\n%s: %d elements, %d unknowns, %s, %.0f steps a second: ms per step, and how many times faster than real "
           "time that is; of each of %d steps the least of %d runs\n",
           title, any->elements, any->unknowns, real_name(), 1 / s->dt, s->steps, o->runs);
    printf("  %-12s %8s %8s %8s %8s %8s %9s %8s %8s %8s %7s %5s %8s %6s %9s %7s %7s\n", "solver", "median", "mean",
           "95 %", "largest", "slowest", "assemble", "contact", "factor", "solve", "iterat.", "fact.", "contacts",
           "alloc.", "x median", "95 %", "largest");
    for (int k = 0; k < SOLVERS; k++) {
        const trajectory *t = &all[k];
        if (!has_run(t, solvers[k].name)) continue;
        double middle = median(t->all, t->steps), high = percentile(t->all, t->steps, 0.95);
        double largest = most(t->all, t->steps);
        printf("  %-12s %8.2f %8.2f %8.2f %8.2f %8.2f %9.2f %8.2f %8.2f %8.2f %7.1f %5d %8d %6ld %9.2f %7.2f %7.2f\n",
               solvers[k].name, 1e3 * middle, 1e3 * mean(t->all, t->steps), 1e3 * high, 1e3 * largest, 1e3 * t->slowest,
               1e3 * mean(t->assemble, t->steps), 1e3 * mean(t->contact, t->steps), 1e3 * mean(t->factor, t->steps),
               1e3 * mean(t->solve, t->steps), t->iterations, t->factorizations, t->most_contacts, t->allocations,
               s->dt / middle, s->dt / high, s->dt / largest);
    }
    fflush(stdout);
    free(all);
}

static void bench_scenes(const options *o) {
    formats_surface surface;
    FILE *file = fopen("build/bunny.obj", "r");
    if (file) fclose(file);
    expect(model_read(file ? "build/bunny.obj" : NULL, &surface), "the model");
    const bunny whole = {&surface, 1}, merged = {&surface, 0};
    const scene cube = {1.0 / 60, o->quick ? 60 : 120, 0, create_cube, NULL};
    const scene fast = {1.0 / 120, MAX_STEPS, 0, create_bunny, &whole};
    const scene demo = {1.0 / 60, MAX_STEPS / 2, 0, create_bunny, &merged};
    bench_real_time("Cube falling on a floor", &cube, o);
    bench_real_time(file ? "Bunny falling on a floor, all slivers kept" : "Built-in shape falling on a floor", &fast,
                    o);
    if (!o->quick) bench_real_time("The demo's, slivers merged", &demo, o);
    formats_free_surface(&surface);
}

int main(int argc, char **argv) {
    program p =
        program_begin(argc, argv, "bench_step [--quick] [--cpu] [--solver NAME] [--only bar|real-time] [--csv FILE]");
    options o;
    memset(&o, 0, sizeof o);
    o.quick = program_flag(&p, "--quick");
    use_cpu_time = program_flag(&p, "--cpu");
    o.solver = program_text(&p, "--solver", NULL);
    o.runs = o.quick ? 2 : 5;
    int only = program_choice(&p, "--only", "bar|real-time", 2);
    const char *path =
        program_text(&p, "--csv", DGFEM_REAL_IS_FLOAT ? "build/bench/step_float.csv" : "build/bench/step_double.csv");
    program_end(&p);
    if (only != 1) o.csv = fopen(path, "w");
    if (only != 1 && !o.csv) fprintf(stderr, "bench_step: %s cannot be written\n", path);
    if (o.csv)
        fprintf(o.csv, "real,unknowns,solver,median,mean,p95,largest,assemble,factor,solve,iterations,factorizations,"
                       "tip_length,tip_way\n");
    for (int k = 0; only != 1 && k < 3; k++) bench_bar(&bars[k], &o);
    if (o.runs > 3) o.runs = 3; /* these are long */
    if (only != 0) bench_scenes(&o);
    if (o.csv) fclose(o.csv);
    return 0;
}
