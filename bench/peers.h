/* Other solvers, timed repeat by repeat: CHOLMOD, where the program is built with -DHAVE_CHOLMOD and linked with
   -lcholmod -lopenblas, and Eigen's SimplicialLLT, where it is built with -DHAVE_EIGEN and linked with eigen.cpp. Both
   work in double, whatever dgfem_real is. */
#ifndef PEERS_H
#define PEERS_H

#include "bench.h"

#ifdef HAVE_CHOLMOD
#include <suitesparse/cholmod.h>

char *openblas_get_corename(void);
#endif

typedef struct figures {
    double analyse[MAX_REPEATS], factor[MAX_REPEATS], solve[MAX_REPEATS], all[MAX_REPEATS]; /* seconds */
    int count;
    double flops, entries, bytes;
    double residual; /* largest |b - A x| */
} figures;

static inline void record(figures *f, double t0, double t1, double t2, double t3) {
    f->analyse[f->count] = t1 - t0;
    f->factor[f->count] = t2 - t1;
    f->solve[f->count] = t3 - t2;
    f->all[f->count++] = t3 - t0;
}

static inline double residual(const dgfem_matrix *matrix, const dgfem_real *b, const dgfem_real *x) {
    dgfem_real *y = (dgfem_real *)room((size_t)matrix->size, sizeof(dgfem_real));
    double worst = 0;
    dgfem_matrix_multiply(matrix, x, y);
    for (int i = 0; i < matrix->size; i++) {
        double error = fabs((double)b[i] - (double)y[i]);
        if (!(error <= worst)) worst = error;
    }
    free(y);
    return worst;
}

/* ---- compressed columns ---- */

static inline size_t stored_values(const dgfem_matrix *matrix) {
    return matrix->value_start[matrix->row_start[matrix->block_count]];
}

/* The lower half by rows, which is the upper half by columns: start[size + 1], row and value[stored_values]. */
static inline void to_columns(const dgfem_matrix *matrix, int *start, int *row, double *value) {
    start[0] = 0;
    for (int r = 0; r < matrix->block_count; r++)
        for (int i = 0; i < matrix->offset[r + 1] - matrix->offset[r]; i++) {
            int column = matrix->offset[r] + i, at = start[column];
            for (int k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
                int first = matrix->offset[matrix->column[k]], width = matrix->offset[matrix->column[k] + 1] - first;
                for (int j = 0; j < width && first + j <= column; j++) {
                    row[at] = first + j;
                    value[at++] = (double)matrix->values[matrix->value_start[k] + (size_t)(i * width + j)];
                }
            }
            start[column + 1] = at;
        }
}

/* ---- CHOLMOD ---- */

#ifdef HAVE_CHOLMOD
typedef enum setting { UNKNOWNS_METIS, UNKNOWNS_AMD, BLOCKS_METIS, BLOCKS_AMD, GIVEN, SETTINGS } setting;

static const char *const setting_names[SETTINGS] = {"METIS", "AMD", "block METIS", "block AMD", "our order"};

static inline cholmod_sparse *to_cholmod(const dgfem_matrix *matrix, cholmod_common *common) {
    cholmod_sparse *a = cholmod_allocate_sparse((size_t)matrix->size, (size_t)matrix->size, stored_values(matrix), 1, 1,
                                                1, CHOLMOD_REAL, common);
    to_columns(matrix, (int *)a->p, (int *)a->i, (double *)a->x);
    return a;
}

/* The graph of blocks, upper half. */
static inline cholmod_sparse *block_graph(const dgfem_matrix *matrix, cholmod_common *common) {
    int n = matrix->block_count;
    cholmod_sparse *a =
        cholmod_allocate_sparse((size_t)n, (size_t)n, (size_t)matrix->row_start[n], 1, 1, 1, CHOLMOD_PATTERN, common);
    memcpy(a->p, matrix->row_start, ((size_t)n + 1) * sizeof(int));
    memcpy(a->i, matrix->column, (size_t)matrix->row_start[n] * sizeof(int));
    return a;
}

/* order becomes METIS's or AMD's of the graph of blocks. */
static inline void order_blocks(const dgfem_matrix *matrix, setting how, int *order, cholmod_common *common) {
    cholmod_sparse *graph = block_graph(matrix, common);
    if (how == BLOCKS_METIS) expect(cholmod_metis(graph, NULL, 0, 1, order, common), "cholmod_metis");
    else expect(cholmod_amd(graph, NULL, 0, order, common), "cholmod_amd");
    cholmod_free_sparse(&graph, common);
}

/* x receives the solution. `own` is dgfem's order. */
static inline void run_cholmod(const dgfem_matrix *matrix, cholmod_sparse *a, setting how, const int *own,
                               const dgfem_real *b, dgfem_real *x, figures *f, cholmod_common *common) {
    int *order = (int *)room((size_t)matrix->block_count, sizeof(int));
    int *unknowns = (int *)room((size_t)matrix->size, sizeof(int)), used = 0;
    cholmod_dense *rhs = cholmod_allocate_dense((size_t)matrix->size, 1, (size_t)matrix->size, CHOLMOD_REAL, common);
    for (int k = 0; k < matrix->size; k++) ((double *)rhs->x)[k] = (double)b[k];
    common->supernodal = CHOLMOD_SUPERNODAL;
    common->nmethods = 1;
    common->method[0].ordering = how == UNKNOWNS_METIS ? CHOLMOD_METIS
                                 : how == UNKNOWNS_AMD ? CHOLMOD_AMD
                                                       : CHOLMOD_GIVEN;
    double t0 = seconds();
    if (how == GIVEN && own) memcpy(order, own, (size_t)matrix->block_count * sizeof *order);
    else if (how >= BLOCKS_METIS) order_blocks(matrix, how, order, common);
    for (int k = 0; how >= BLOCKS_METIS && k < matrix->block_count; k++)
        for (int i = matrix->offset[order[k]]; i < matrix->offset[order[k] + 1]; i++) unknowns[used++] = i;
    cholmod_factor *factor =
        how < BLOCKS_METIS ? cholmod_analyze(a, common) : cholmod_analyze_p(a, unknowns, NULL, 0, common);
    double t1 = seconds();
    expect(cholmod_factorize(a, factor, common), "cholmod_factorize");
    double t2 = seconds();
    f->flops = common->fl;
    f->entries = common->lnz;
    cholmod_dense *result = cholmod_solve(CHOLMOD_A, factor, rhs, common);
    record(f, t0, t1, t2, seconds());
    f->bytes = (double)factor->xsize * sizeof(double) + (double)factor->ssize * sizeof(int);
    for (int k = 0; k < matrix->size; k++) x[k] = (dgfem_real)((double *)result->x)[k];
    cholmod_free_dense(&result, common);
    cholmod_free_factor(&factor, common);
    cholmod_free_dense(&rhs, common);
    free(order);
    free(unknowns);
    if (f->count == 1) f->residual = residual(matrix, b, x);
}

/* The stock setting that takes least time in all. */
static inline setting best_setting(const dgfem_matrix *matrix, cholmod_sparse *a, const dgfem_real *b, dgfem_real *x,
                                   cholmod_common *common) {
    double best = 1e300;
    setting found = UNKNOWNS_METIS;
    for (int how = UNKNOWNS_METIS; how < GIVEN; how++)
        for (int repeat = 0; repeat < (matrix->size < 20000 ? 3 : 1); repeat++) {
            figures f;
            memset(&f, 0, sizeof f);
            run_cholmod(matrix, a, (setting)how, NULL, b, x, &f, common);
            if (f.all[0] < best) best = f.all[0], found = (setting)how;
        }
    return found;
}
#endif

/* ---- Eigen ---- */

#ifdef HAVE_EIGEN
/* The upper half in compressed columns; seconds[3]: analysis, factorization, solve. 0 where it fails. In eigen.cpp. */
int eigen_llt(int size, const int *start, const int *row, const double *value, const double *b, double *x,
              double (*clock)(void *user), double *seconds);

static inline void run_eigen(const dgfem_matrix *matrix, const dgfem_real *b, dgfem_real *x, figures *f) {
    size_t n = (size_t)matrix->size, count = stored_values(matrix);
    int *start = (int *)room(n + 1, sizeof(int)), *row = (int *)room(count, sizeof(int));
    double *value = (double *)room(count, sizeof(double)), *right = (double *)room(2 * n, sizeof(double)), times[3];
    to_columns(matrix, start, row, value);
    for (size_t i = 0; i < n; i++) right[i] = (double)b[i];
    expect(eigen_llt(matrix->size, start, row, value, right, right + n, bench_clock, times), "Eigen");
    record(f, 0, times[0], times[0] + times[1], times[0] + times[1] + times[2]);
    for (size_t i = 0; i < n; i++) x[i] = (dgfem_real)right[n + i];
    if (f->count == 1) f->residual = residual(matrix, b, x);
    free(start);
    free(row);
    free(value);
    free(right);
}
#endif

#endif
