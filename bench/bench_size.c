/* Time and memory against size, from 1,000 to 300,000 unknowns: cubes of hexahedra, held on one side, that swing down.

       bench_size [--quick] [--large] [--cpu] [--solver NAME] [--only factor|step|memory|threads]

   Four tables: the Cholesky factorization of a step's matrix; a step of each solver, with what it keeps in memory; the
   memory of a body of 96,000 unknowns by its parts; two threads beside one, bit by bit. --quick stops at 12,000
   unknowns and leaves the last two out, the default stops at 49,152, --large goes on to 292,668 (8 GB of memory).
   --cpu counts the processor's time in place of the wall's, but for threads. The first two go to
   build/bench/size_factor.csv and build/bench/size_step.csv as well. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "bench.h"
#include "box.h"
#include "program.h"
#include "solvers.h"
#include "threads.h"

enum { SIZES = 9, MAX_STEPS = 60 };

static const int cells_along[SIZES] = {4, 6, 8, 10, 12, 16, 20, 24, 29};

static const double dt = 1.0 / 60;

static box cube_of(int n, int degree, dgfem_solver solver) {
    const int cells[3] = {n, n, n};
    box b = box_of(1, 1, 1, cells, solver);
    b.degree = degree;
    return b;
}

static void step(dgfem_body *body, dgfem_step_info *info) {
    expect(dgfem_body_step(body, (dgfem_real)dt, info) == DGFEM_OK, "dgfem_body_step");
}

static dgfem_real *vector_of(int size) { return (dgfem_real *)room((size_t)size, sizeof(dgfem_real)); }

static FILE *open_csv(const char *path, const char *head) {
    FILE *file = fopen(path, "w");
    if (!file) fprintf(stderr, "bench_size: %s cannot be written\n", path);
    if (file) fprintf(file, "%s\n", head);
    return file;
}

/* ---- factorization ---- */

typedef struct factor_times {
    double analyse, factor, solve, product; /* least seconds */
    double bytes;                           /* of the analysed object */
    dgfem_cholesky_info info;
} factor_times;

static double shorter(double best, double start) { return fmin(best, seconds() - start); }

static factor_times time_factor(const dgfem_matrix *matrix, int repeats) {
    factor_times t;
    dgfem_real *b = vector_of(matrix->size), *x = vector_of(matrix->size);
    memset(&t, 0, sizeof t);
    t.analyse = t.factor = t.solve = t.product = 1e300;
    for (int i = 0; i < matrix->size; i++) b[i] = noise();
    for (int r = 0; r < repeats; r++) {
        dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
        dgfem_cholesky *cholesky = NULL;
        counted memory;
        memset(&memory, 0, sizeof memory);
        desc.hooks = bench_hooks(&memory);
        double start = seconds();
        expect(dgfem_cholesky_create(matrix, &desc, &cholesky) == DGFEM_OK, "dgfem_cholesky_create");
        t.analyse = shorter(t.analyse, start);
        start = seconds();
        expect(dgfem_cholesky_factor(cholesky, matrix, &t.info) == DGFEM_OK, "dgfem_cholesky_factor");
        t.factor = shorter(t.factor, start);
        start = seconds();
        expect(dgfem_cholesky_solve(cholesky, b, x) == DGFEM_OK, "dgfem_cholesky_solve");
        t.solve = shorter(t.solve, start);
        t.bytes = memory.live;
        dgfem_cholesky_destroy(cholesky);
        for (int k = 0; k < 4; k++) {
            start = seconds();
            dgfem_matrix_multiply(matrix, b, x);
            t.product = shorter(t.product, start);
        }
    }
    free(b);
    free(x);
    return t;
}

/* Multiplications and additions of a product. */
static double product_flops(const dgfem_matrix *matrix) {
    double flops = 0;
    for (int r = 0; r < matrix->block_count; r++)
        for (int k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++)
            flops +=
                (matrix->column[k] == r ? 2.0 : 4.0) * (double)(matrix->value_start[k + 1] - matrix->value_start[k]);
    return flops;
}

static void bench_factor(int sizes) {
    FILE *csv = open_csv("build/bench/size_factor.csv",
                         "unknowns,analyse,factor,solve,product,flops,entries,bytes,product_flops");
    printf("\nCholesky factorization of a step's matrix, %s: least ms\n", real_name());
    printf("  %9s %9s %10s %9s %9s %9s %9s %9s %9s %9s\n", "unknowns", "analyse", "factor", "solve", "product", "GFLOP",
           "GFLOP/s", "(product)", "1e6 L", "MB");
    for (int k = 0; k < sizes; k++) {
        box b = cube_of(cells_along[k], 1, DGFEM_SOLVER_PCG); /* keeps the matrix that it solves */
        dgfem_body *body = box_body(&b);
        step(body, NULL);
        factor_times t = time_factor(body->matrix, k < 4 ? 15 : k < 6 ? 5 : 1);
        double flops = product_flops(body->matrix);
        printf("  %9d %9.2f %10.2f %9.2f %9.3f %9.3f %9.1f %9.1f %9.2f %9.1f\n", body->matrix->size, 1e3 * t.analyse,
               1e3 * t.factor, 1e3 * t.solve, 1e3 * t.product, 1e-9 * t.info.factor_flops,
               1e-9 * t.info.factor_flops / t.factor, 1e-9 * flops / t.product, 1e-6 * t.info.factor_entries,
               1e-6 * t.bytes);
        fflush(stdout);
        if (csv)
            fprintf(csv, "%d,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", body->matrix->size, t.analyse, t.factor,
                    t.solve, t.product, t.info.factor_flops, t.info.factor_entries, t.bytes, flops);
        dgfem_body_destroy(body);
    }
    if (csv) fclose(csv);
}

/* ---- memory ---- */

/* Bytes of a body, by its parts. */
typedef struct parts {
    double mesh, matrix, vectors, integrals, solver, all, peak;
} parts;

static double matrix_bytes(const dgfem_matrix *m) {
    size_t blocks = (size_t)m->row_start[m->block_count], count = (size_t)m->block_count;
    size_t values = m->value_start[blocks] * sizeof(dgfem_real) + (blocks + 1) * sizeof(size_t);
    return (double)(values + (blocks + 2 * (count + 1)) * sizeof(int) + count * sizeof(dgfem_vec3));
}

/* State and right-hand sides: seven vectors; and a few numbers per element. */
static double vector_bytes(const dgfem_body *body) {
    size_t element =
        2 * sizeof(dgfem_mat3) + sizeof(dgfem_vec3) + sizeof(dgfem_material) + sizeof(dgfem_real) + 2 * sizeof(int);
    return (double)(7 * (size_t)body->basis_count * sizeof(dgfem_vec3) + (size_t)body->mesh->element_count * element);
}

/* A body whose allocations are counted; memory[2]: of its mesh and of all else. */
static dgfem_body *counted_body(box b, counted *memory) {
    memset(memory, 0, 2 * sizeof *memory);
    b.mesh_hooks = bench_hooks(&memory[0]);
    b.hooks = bench_hooks(&memory[1]);
    return box_body(&b);
}

/* The parts that do not depend on the solver: those of a body with PCG, which needs the least, without its vectors. */
static parts common_parts(box b) {
    parts p;
    counted memory[2];
    memset(&p, 0, sizeof p);
    b.solver = DGFEM_SOLVER_PCG;
    dgfem_body *body = counted_body(b, memory);
    p.mesh = memory[0].live;
    p.matrix = matrix_bytes(body->matrix);
    p.vectors = vector_bytes(body);
    p.integrals =
        memory[1].live - p.matrix - p.vectors - (double)(dgfem_pcg_work_size(body->matrix) * sizeof(dgfem_real));
    dgfem_body_destroy(body);
    return p;
}

static void set_solver_part(parts *p, const counted *memory) {
    p->solver = memory[1].live - p->matrix - p->vectors - p->integrals;
    p->all = memory[0].live + memory[1].live;
    p->peak = memory[0].live + memory[1].peak;
}

static void print_part(const char *name, double bytes, double all, const char *what) {
    printf("  %-12s %9.1f MB %5.1f %%  %s\n", name, 1e-6 * bytes, 100 * bytes / all, what);
}

static void bench_memory(void) {
    box b = cube_of(20, 1, DGFEM_SOLVER_CHOLESKY);
    parts p = common_parts(b);
    counted memory[2];
    char text[200];
    dgfem_body *body = counted_body(b, memory);
    const dgfem_matrix *m = body->matrix;
    step(body, NULL);
    set_solver_part(&p, memory);
    dgfem_cholesky_info info;
    expect(dgfem_cholesky_factor(body->cholesky, m, &info) == DGFEM_OK, "dgfem_cholesky_factor");
    double entries = info.factor_entries * sizeof(dgfem_real);
    printf("\nMemory of a body of %d unknowns, %d elements and %d faces, %s, with Cholesky's solver: %.1f MB (at most "
           "%.1f "
           "while it was made)\n",
           m->size, body->mesh->element_count, body->mesh->face_count, real_name(), 1e-6 * p.all, 1e-6 * p.peak);
    print_part("mesh", p.mesh, p.all, "vertices, faces, loops, elements");
    print_part("integrals", p.integrals, p.all, "mass and stiffness of elements and faces at rest");
    snprintf(text, sizeof text, "%d blocks of 12 x 12, lower half", m->row_start[m->block_count]);
    print_part("matrix", p.matrix, p.all, text);
    print_part("vectors", p.vectors, p.all,
               "displacement, velocity, forces, right-hand sides; rotations and materials");
    snprintf(text, sizeof text, "%.1f million numbers of L: %.1f MB; the rest: its stored zeros, fronts, indices",
             1e-6 * info.factor_entries, 1e-6 * entries);
    print_part("factor", p.solver, p.all, text);
    dgfem_body_destroy(body);
}

/* ---- a step ---- */

typedef struct step_times {
    double create, all[MAX_STEPS], assemble[MAX_STEPS], factor[MAX_STEPS], solve[MAX_STEPS];
    double iterations;
    int count, factorizations;
    parts memory;
} step_times;

/* As many steps as fit in a few seconds, three at least. */
static int time_steps(box b, step_times *t) {
    counted memory[2];
    double start = seconds(), begin;
    dgfem_body *body = counted_body(b, memory);
    int unknowns = 3 * body->basis_count;
    t->create = seconds() - start;
    begin = seconds();
    while (t->count < MAX_STEPS && (t->count < 3 || seconds() - begin < 10)) {
        dgfem_step_info info;
        start = seconds();
        step(body, &info);
        t->all[t->count] = seconds() - start;
        t->assemble[t->count] = info.seconds_assemble + info.seconds_contact;
        t->factor[t->count] = info.seconds_factor;
        t->solve[t->count++] = info.seconds_solve;
        t->iterations += info.iterations;
        t->factorizations += info.factorizations;
    }
    t->iterations /= t->count;
    set_solver_part(&t->memory, memory);
    dgfem_body_destroy(body);
    return unknowns;
}

static void print_steps(FILE *csv, int unknowns, const char *name, const step_times *t) {
    const parts *p = &t->memory;
    double middle = median(t->all, t->count), high = percentile(t->all, t->count, 0.95);
    double assemble = mean(t->assemble, t->count), factor = mean(t->factor, t->count), solve = mean(t->solve, t->count);
    printf("  %9d %-11s %8.1f %9.2f %9.2f %9.2f %9.2f %9.2f %7.1f %5d/%-3d %8.1f %7.1f %7.1f %7.1f %7.1f %8.1f\n",
           unknowns, name, 1e3 * t->create, 1e3 * middle, 1e3 * high, 1e3 * assemble, 1e3 * factor, 1e3 * solve,
           t->iterations, t->factorizations, t->count, 1e-6 * p->all, 1e-6 * p->mesh, 1e-6 * p->integrals,
           1e-6 * p->matrix, 1e-6 * p->vectors, 1e-6 * p->solver);
    fflush(stdout);
    if (csv)
        fprintf(csv, "%d,%s,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%d,%d,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", unknowns, name,
                t->create, middle, high, assemble, factor, solve, t->iterations, t->factorizations, t->count, p->all,
                p->mesh, p->integrals, p->matrix, p->vectors, p->solver);
}

static void bench_steps(int sizes, const char *only) {
    FILE *csv = open_csv("build/bench/size_step.csv",
                         "unknowns,solver,create,median,p95,assemble,factor,solve,iterations,factorizations,steps,"
                         "bytes,mesh,integrals,matrix,vectors,solver_bytes");
    step_times *t = (step_times *)room(1, sizeof *t);
    printf("\nA step of each solver, %s: ms, phases as means; MB\n", real_name());
    printf("  %9s %-11s %8s %9s %9s %9s %9s %9s %7s %9s %8s %7s %7s %7s %7s %8s\n", "unknowns", "solver", "create",
           "median", "95 %", "assemble", "factor", "solve", "iterat.", "fact./of", "MB", "mesh", "integr.", "matrix",
           "vectors", "solver");
    for (int k = 0; k < sizes; k++) {
        box b = cube_of(cells_along[k], 1, DGFEM_SOLVER_PCG);
        parts common = common_parts(b);
        for (int s = 0; s < SOLVERS; s++) {
            if (!is_wanted(&solvers[s], only)) continue;
            memset(t, 0, sizeof *t);
            t->memory = common;
            b.solver = solvers[s].solver;
            int unknowns = time_steps(b, t);
            print_steps(csv, unknowns, solvers[s].name, t);
        }
    }
    free(t);
    if (csv) fclose(csv);
}

/* ---- threads ---- */

enum { FACTOR, SOLVE, PRODUCT, ASSEMBLE, STEP, TIMED };

static const char *const timed_names[TIMED] = {"factor", "solve", "product", "assemble", "step"};

/* One number of workers; results[]: factor and solve, product, displacement. */
typedef struct lane {
    dgfem_body *body;
    dgfem_cholesky *cholesky;
    dgfem_real *solution, *product;
    double best[TIMED];
} lane;

static void lane_open(lane *l, box b, workers *w) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    if (w) b.hooks.parallel_for = workers_parallel_for, b.hooks.parallel_for_user = w;
    l->body = box_body(&b);
    step(l->body, NULL);
    desc.hooks = b.hooks;
    expect(dgfem_cholesky_create(l->body->matrix, &desc, &l->cholesky) == DGFEM_OK, "dgfem_cholesky_create");
    l->solution = vector_of(l->body->matrix->size);
    l->product = vector_of(l->body->matrix->size);
    for (int k = 0; k < TIMED; k++) l->best[k] = 1e300;
}

static void lane_run(lane *l, const dgfem_real *b) {
    const dgfem_matrix *matrix = l->body->matrix;
    dgfem_step_info info;
    double start = seconds();
    expect(dgfem_cholesky_factor(l->cholesky, matrix, NULL) == DGFEM_OK, "dgfem_cholesky_factor");
    l->best[FACTOR] = shorter(l->best[FACTOR], start);
    for (int k = 0; k < 3; k++) {
        start = seconds();
        expect(dgfem_cholesky_solve(l->cholesky, b, l->solution) == DGFEM_OK, "dgfem_cholesky_solve");
        l->best[SOLVE] = shorter(l->best[SOLVE], start);
        start = seconds();
        dgfem_matrix_multiply(matrix, b, l->product);
        l->best[PRODUCT] = shorter(l->best[PRODUCT], start);
    }
    start = seconds();
    step(l->body, &info);
    l->best[STEP] = shorter(l->best[STEP], start);
    l->best[ASSEMBLE] = fmin(l->best[ASSEMBLE], info.seconds_assemble);
}

static void lane_close(lane *l) {
    dgfem_cholesky_destroy(l->cholesky);
    dgfem_body_destroy(l->body);
    free(l->solution);
    free(l->product);
}

static const char *same_bits(const void *a, const void *b, size_t bytes) { return memcmp(a, b, bytes) ? "NO" : "yes"; }

/* The lanes take turns. */
static void bench_two(int n, int degree) {
    const int repeats = 12;
    box b = cube_of(n, degree, DGFEM_SOLVER_AUTO);
    lane lanes[2];
    workers two;
    memset(lanes, 0, sizeof lanes);
    workers_start(&two, 2);
    lane_open(&lanes[0], b, NULL);
    lane_open(&lanes[1], b, &two);
    int size = lanes[0].body->matrix->size;
    dgfem_real *right = vector_of(size);
    for (int i = 0; i < size; i++) right[i] = noise();
    for (int r = 0; r < repeats; r++)
        for (int k = 0; k < 2; k++) lane_run(&lanes[k], right);
    for (int k = 0; k < TIMED; k++)
        printf("  %9d %6d  %-9s %9.2f %9.2f %7.2f\n", size, degree, timed_names[k], 1e3 * lanes[0].best[k],
               1e3 * lanes[1].best[k], lanes[0].best[k] / lanes[1].best[k]);
    size_t bytes = (size_t)size * sizeof(dgfem_real);
    printf("  same bits: solution %s, product %s, displacement after %d steps %s\n",
           same_bits(lanes[0].solution, lanes[1].solution, bytes), same_bits(lanes[0].product, lanes[1].product, bytes),
           repeats + 1, same_bits(lanes[0].body->displacement, lanes[1].body->displacement, bytes));
    fflush(stdout);
    free(right);
    lane_close(&lanes[0]);
    lane_close(&lanes[1]);
    workers_stop(&two);
}

static void bench_threads(int large) {
    use_cpu_time = 0;
    printf("\nTwo threads beside one, %s: least ms of 12 runs in turns\n", real_name());
    printf("  %9s %6s  %-9s %9s %9s %7s\n", "unknowns", "degree", "", "one", "two", "ratio");
    bench_two(10, 2);
    bench_two(14, 1);
    bench_two(16, 1);
    if (large) bench_two(20, 1);
}

int main(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "bench_size [--quick] [--large] [--cpu] [--solver NAME]\n"
                              "  [--only factor|step|memory|threads]");
    int quick = program_flag(&p, "--quick"), large = program_flag(&p, "--large"), sizes = large ? SIZES : quick ? 4 : 6;
    const char *solver = program_text(&p, "--solver", NULL);
    int only = program_choice(&p, "--only", "factor|step|memory|threads", 4), all = only == 4;
    use_cpu_time = program_flag(&p, "--cpu");
    program_end(&p);
    if (all || only == 0) bench_factor(sizes);
    if (all || only == 1) bench_steps(sizes, solver);
    if ((all && !quick) || only == 2) bench_memory();
    if ((all && !quick) || only == 3) bench_threads(large);
    return 0;
}
