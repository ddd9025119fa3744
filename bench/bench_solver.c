/* The sparse solver on grids of hexahedra, 12 unknowns each, coupled as interior penalty couples them: time of
   analysis, factorization, solve and product.

   Beside CHOLMOD, where it is installed (libsuitesparse-dev, libopenblas-dev), in the same run and on one thread:
       gcc -std=c99 -D_POSIX_C_SOURCE=200809L -O3 -march=native -DHAVE_CHOLMOD -I. -o bench_solver \
           bench/bench_solver.c -lcholmod -lopenblas -lm
       OMP_THREAD_LIMIT=1 OPENBLAS_NUM_THREADS=1 ./bench_solver */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include <stdio.h>
#include <time.h>

#ifdef HAVE_CHOLMOD
#include <suitesparse/cholmod.h>
#endif

enum { WIDTH = 12 };

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void *room(size_t count, size_t size) {
    void *p = calloc(count + 1, size);
    if (!p) {
        fprintf(stderr, "bench_solver: out of memory\n");
        exit(1);
    }
    return p;
}

static void expect(int good, const char *what) {
    if (good) return;
    fprintf(stderr, "bench_solver: %s failed\n", what);
    exit(1);
}

/* Uniform in -0.5..0.5, the same in every run. */
static dgfem_real noise(void) {
    static uint64_t state = 1;
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (dgfem_real)((double)(state >> 11) * (1.0 / 9007199254740992.0) - 0.5);
}

static dgfem_matrix *make_grid(int n) {
    int count = n * n * n, pairs = 0, i, k, a, b;
    int *sizes = (int *)room((size_t)count, sizeof(int)), *pair = (int *)room((size_t)count * 6, sizeof(int));
    dgfem_vec3 *centres = (dgfem_vec3 *)room((size_t)count, sizeof(dgfem_vec3));
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    dgfem_matrix *matrix;
    for (i = 0; i < count; i++) {
        int place[3], step[3] = {1, n, n * n};
        place[0] = i % n, place[1] = i / n % n, place[2] = i / (n * n);
        sizes[i] = WIDTH;
        centres[i].x = (dgfem_real)place[0];
        centres[i].y = (dgfem_real)place[1];
        centres[i].z = (dgfem_real)place[2];
        for (k = 0; k < 3; k++)
            if (place[k] > 0) {
                pair[2 * pairs] = i;
                pair[2 * pairs++ + 1] = i - step[k];
            }
    }
    desc.block_count = count;
    desc.block_sizes = sizes;
    desc.pairs = pair;
    desc.pair_count = pairs;
    desc.centres = centres;
    expect(dgfem_matrix_create(&desc, &matrix) == DGFEM_OK, "dgfem_matrix_create");
    for (i = 0; i < count; i++)
        for (k = matrix->row_start[i]; k < matrix->row_start[i + 1]; k++) {
            dgfem_real *block = matrix->values + matrix->value_start[k];
            for (a = 0; a < WIDTH; a++)
                for (b = 0; b < WIDTH; b++) block[a * WIDTH + b] = noise();
            if (matrix->column[k] != i) continue;
            for (a = 0; a < WIDTH; a++) {
                for (b = 0; b < a; b++) block[b * WIDTH + a] = block[a * WIDTH + b];
                block[a * WIDTH + a] = DGFEM_R(2.5) * WIDTH;
            }
        }
    free(sizes);
    free(pair);
    free(centres);
    return matrix;
}

typedef struct figures {
    double analysis, factor, solve, product; /* seconds */
    double flops, entries;
    double residual; /* largest |b - A x| */
} figures;

static double residual(const dgfem_matrix *matrix, const dgfem_real *b, const dgfem_real *x) {
    dgfem_real *y = (dgfem_real *)room((size_t)matrix->size, sizeof(dgfem_real));
    double worst = 0;
    int i;
    dgfem_matrix_multiply(matrix, x, y);
    for (i = 0; i < matrix->size; i++) {
        double error = fabs((double)b[i] - (double)y[i]);
        if (!(error <= worst)) worst = error;
    }
    free(y);
    return worst;
}

static double shortest(double a, double b) { return a == 0 || b < a ? b : a; }

static figures run_dgfem(const dgfem_matrix *matrix, const dgfem_real *b, int repeats) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_real *x = (dgfem_real *)room((size_t)matrix->size, sizeof(dgfem_real));
    dgfem_cholesky_info info;
    dgfem_cholesky *cholesky = NULL;
    figures f;
    int k;
    memset(&f, 0, sizeof f);
    for (k = 0; k < repeats; k++) {
        double t = seconds();
        dgfem_cholesky_destroy(cholesky);
        expect(dgfem_cholesky_create(matrix, &desc, &cholesky) == DGFEM_OK, "dgfem_cholesky_create");
        f.analysis = shortest(f.analysis, seconds() - t);
    }
    for (k = 0; k < repeats; k++) {
        double t = seconds();
        expect(dgfem_cholesky_factor(cholesky, matrix, &info) == DGFEM_OK, "dgfem_cholesky_factor");
        f.factor = shortest(f.factor, seconds() - t);
    }
    for (k = 0; k < 4 * repeats; k++) {
        double t = seconds();
        expect(dgfem_cholesky_solve(cholesky, b, x) == DGFEM_OK, "dgfem_cholesky_solve");
        f.solve = shortest(f.solve, seconds() - t);
    }
    f.residual = residual(matrix, b, x);
    for (k = 0; k < 4 * repeats; k++) {
        double t = seconds();
        dgfem_matrix_multiply(matrix, b, x);
        f.product = shortest(f.product, seconds() - t);
    }
    f.flops = info.factor_flops;
    f.entries = info.factor_entries;
    dgfem_cholesky_destroy(cholesky);
    free(x);
    return f;
}

#ifdef HAVE_CHOLMOD
/* The lower half in compressed columns, which is the rows of blocks read as columns of the upper half. */
static cholmod_sparse *to_cholmod(const dgfem_matrix *matrix, cholmod_common *common) {
    size_t entries = 0;
    cholmod_sparse *a;
    int *start, *row, r, k, i, j;
    double *value;
    for (r = 0; r < matrix->block_count; r++)
        entries += (size_t)(matrix->row_start[r + 1] - matrix->row_start[r]) * WIDTH * WIDTH;
    a = cholmod_allocate_sparse((size_t)matrix->size, (size_t)matrix->size, entries, 1, 1, 1, CHOLMOD_REAL, common);
    start = (int *)a->p, row = (int *)a->i, value = (double *)a->x;
    for (r = 0; r < matrix->block_count; r++)
        for (i = 0; i < WIDTH; i++) {
            int column = r * WIDTH + i, at = start[column];
            for (k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++)
                for (j = 0; j < WIDTH; j++) {
                    if (matrix->column[k] * WIDTH + j > column) continue;
                    row[at] = matrix->column[k] * WIDTH + j;
                    value[at++] = (double)matrix->values[matrix->value_start[k] + (size_t)(i * WIDTH + j)];
                }
            start[column + 1] = at;
        }
    return a;
}

static figures run_cholmod(const dgfem_matrix *matrix, const dgfem_real *b, int repeats) {
    dgfem_real *result = (dgfem_real *)room((size_t)matrix->size, sizeof(dgfem_real));
    cholmod_common common;
    cholmod_sparse *a;
    cholmod_dense *rhs, *x = NULL;
    cholmod_factor *factor = NULL;
    figures f;
    int k;
    memset(&f, 0, sizeof f);
    cholmod_start(&common);
    common.supernodal = CHOLMOD_SUPERNODAL;
    a = to_cholmod(matrix, &common);
    rhs = cholmod_allocate_dense((size_t)matrix->size, 1, (size_t)matrix->size, CHOLMOD_REAL, &common);
    for (k = 0; k < matrix->size; k++) ((double *)rhs->x)[k] = (double)b[k];
    for (k = 0; k < repeats; k++) {
        double t = seconds();
        cholmod_free_factor(&factor, &common);
        factor = cholmod_analyze(a, &common);
        f.analysis = shortest(f.analysis, seconds() - t);
    }
    for (k = 0; k < repeats; k++) {
        double t = seconds();
        expect(cholmod_factorize(a, factor, &common), "cholmod_factorize");
        f.factor = shortest(f.factor, seconds() - t);
    }
    f.flops = common.fl;
    f.entries = common.lnz;
    for (k = 0; k < 4 * repeats; k++) {
        double t = seconds();
        cholmod_free_dense(&x, &common);
        x = cholmod_solve(CHOLMOD_A, factor, rhs, &common);
        f.solve = shortest(f.solve, seconds() - t);
    }
    for (k = 0; k < matrix->size; k++) result[k] = (dgfem_real)((double *)x->x)[k];
    f.residual = residual(matrix, b, result);
    cholmod_free_dense(&x, &common);
    cholmod_free_dense(&rhs, &common);
    cholmod_free_factor(&factor, &common);
    cholmod_free_sparse(&a, &common);
    cholmod_finish(&common);
    free(result);
    return f;
}
#endif

static void print(const char *name, const figures *f) {
    printf("  %-8s %10.2f %10.2f %9.3f %9.2f %9.2f %9.2f", name, 1e3 * f->analysis, 1e3 * f->factor, 1e-9 * f->flops,
           1e-9 * f->flops / f->factor, 1e-6 * f->entries, 1e3 * f->solve);
    if (f->product > 0) printf(" %9.3f", 1e3 * f->product);
    else printf(" %9s", "-");
    printf(" %9.1e\n", f->residual);
}

int main(void) {
    static const int cells[3] = {10, 16, 20};
    int k, i;
    for (k = 0; k < 3; k++) {
        int n = cells[k], repeats = n > 12 ? 1 : 5;
        dgfem_matrix *matrix = make_grid(n);
        dgfem_real *b = (dgfem_real *)room((size_t)matrix->size, sizeof(dgfem_real));
        figures own;
        for (i = 0; i < matrix->size; i++) b[i] = noise();
        printf("%d^3 hexahedra, %d unknowns\n", n, matrix->size);
        printf("  %-8s %10s %10s %9s %9s %9s %9s %9s %9s\n", "", "analyse ms", "factor ms", "GFLOP", "GFLOP/s",
               "1e6 in L", "solve ms", "product", "residual");
        own = run_dgfem(matrix, b, repeats);
        print("dgfem", &own);
#ifdef HAVE_CHOLMOD
        {
            figures other = run_cholmod(matrix, b, repeats);
            print("CHOLMOD", &other);
            printf("  %-8s %10.3f %10.3f %9.3f %9.3f %9.3f %9.3f\n", "ratio", own.analysis / other.analysis,
                   own.factor / other.factor, own.flops / other.flops,
                   own.flops / own.factor / (other.flops / other.factor), own.entries / other.entries,
                   own.solve / other.solve);
        }
#endif
        free(b);
        dgfem_matrix_destroy(matrix);
    }
    return 0;
}
