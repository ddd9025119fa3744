/* What the programs in this directory share: the library, tables, condition numbers, quadrature, meshes.

   Each program repeats one experiment of P. Kaufmann, S. Martin, M. Botsch, M. Gross, "Flexible simulation of
   deformable models using discontinuous Galerkin FEM" (2009), or one classical test, and prints tables:

       fig2 [--csv FILE] [--markdown] [--quick]

   --csv writes the tables as blocks for gnuplot (`index 0`, `index 1`, ...), --markdown prints them for RESULTS.md,
   --quick leaves out the finest meshes. */
#ifndef PAPER_H
#define PAPER_H

#define DGFEM_REAL double
#include "dgfem.h"

#include <stdarg.h>

#include "program.h"

/* ---- failure ---- */

/* Ends the program where a call of the library fails. The library has logged the reason. */
static inline void need(dgfem_status status, const char *what) {
    if (!status) return;
    fprintf(stderr, "%s: %s\n", what, dgfem_status_text(status));
    exit(1);
}

static inline void *need_memory(size_t count, size_t size) {
    void *memory = calloc(count ? count : 1, size);
    if (memory) return memory;
    fprintf(stderr, "out of memory\n");
    exit(1);
}

static inline double *need_reals(size_t count) { return (double *)need_memory(count, sizeof(double)); }

static inline dgfem_vec3 vec3(double x, double y, double z) {
    dgfem_vec3 v;
    v.x = x, v.y = y, v.z = z;
    return v;
}

static inline dgfem_plane plane(double nx, double ny, double nz, double offset) {
    dgfem_plane p;
    p.normal = vec3(nx, ny, nz), p.offset = offset;
    return p;
}

/* Seconds of processor time of this program, the measure of all times printed: others may be using the machine. */
static inline double cpu_seconds(void *user) {
    struct timespec now;
    (void)user;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static inline dgfem_hooks paper_hooks(void) {
    dgfem_hooks hooks = program_hooks();
    hooks.clock = cpu_seconds;
    return hooks;
}

/* ---- tables ---- */

enum { PAPER_COLUMNS = 24, PAPER_ROWS = 200, PAPER_CELL = 120 };

/* Collects one table at a time and prints it when it is complete. */
typedef struct paper {
    FILE *csv;
    int markdown, quick;
    int columns, rows;
    char cells[PAPER_ROWS][PAPER_COLUMNS][PAPER_CELL];
} paper;

/* Reads the options that all programs have. It lives on the heap: tables are large. */
static inline paper *paper_begin(program *p) {
    paper *out = (paper *)need_memory(1, sizeof *out);
    const char *csv = program_text(p, "--csv", NULL);
    out->markdown = program_flag(p, "--markdown");
    out->quick = program_flag(p, "--quick");
    program_end(p);
    if (!csv) return out;
    out->csv = fopen(csv, "w");
    if (out->csv) return out;
    fprintf(stderr, "%s: cannot be written\n", csv);
    exit(1);
}

static inline void paper_row_v(paper *out, const char *format, va_list arguments) {
    char text[PAPER_COLUMNS * PAPER_CELL], *cell = text;
    if (out->rows == PAPER_ROWS) return;
    vsnprintf(text, sizeof text, format, arguments);
    for (int column = 0; cell && column < PAPER_COLUMNS; column++) {
        char *bar = strchr(cell, '|');
        if (bar) *bar = '\0';
        snprintf(out->cells[out->rows][column], PAPER_CELL, "%.*s", PAPER_CELL - 1, cell);
        if (column + 1 > out->columns) out->columns = column + 1;
        cell = bar ? bar + 1 : NULL;
    }
    out->rows++;
}

/* A row; cells are separated by '|'. */
#if defined(__GNUC__)
__attribute__((format(printf, 2, 3)))
#endif
static inline void
paper_row(paper *out, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    paper_row_v(out, format, arguments);
    va_end(arguments);
}

/* A table with this title and these columns. */
static inline void paper_table(paper *out, const char *title, const char *columns) {
    memset(out->cells, 0, sizeof out->cells);
    out->rows = out->columns = 0;
    printf(out->markdown ? "\n**%s**\n\n" : "\n%s\n\n", title);
    if (out->csv) fprintf(out->csv, "# %s\n", title);
    paper_row(out, "%s", columns);
}

static inline void paper_print_row(const paper *out, int row, const int *widths) {
    if (out->markdown) printf("|");
    for (int c = 0; c < out->columns; c++) {
        const char *cell = out->cells[row][c];
        if (out->markdown) printf(" %s |", cell);
        else printf(c ? "  %*s" : "%-*s", widths[c], cell);
    }
    printf("\n");
}

/* Prints the table; in the CSV file it becomes one block. */
static inline void paper_print(paper *out) {
    int widths[PAPER_COLUMNS];
    memset(widths, 0, sizeof widths);
    for (int r = 0; r < out->rows; r++)
        for (int c = 0; c < out->columns; c++)
            if ((int)strlen(out->cells[r][c]) > widths[c]) widths[c] = (int)strlen(out->cells[r][c]);
    for (int r = 0; r < out->rows; r++) {
        paper_print_row(out, r, widths);
        if (r || !out->markdown) continue;
        printf("|");
        for (int c = 0; c < out->columns; c++) printf(c ? "---:|" : ":---|");
        printf("\n");
    }
    for (int r = 0; out->csv && r < out->rows; r++)
        for (int c = 0; c < out->columns; c++)
            fprintf(out->csv, "\"%s\"%s", out->cells[r][c], c + 1 < out->columns ? "," : "\n");
    if (out->csv) fprintf(out->csv, "\n\n");
    fflush(stdout);
}

/* A remark under a table. */
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
static inline void
paper_note(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    printf("\n");
    vprintf(format, arguments);
    printf("\n");
    va_end(arguments);
}

static inline void paper_end(paper *out) {
    if (out->csv) fclose(out->csv);
    free(out);
}

/* log2 of the ratio of two errors, for meshes of which one is `ratio` times as fine. */
static inline double paper_rate(double coarse, double fine, double ratio) { return log(coarse / fine) / log(ratio); }

/* ---- dense matrices, row-major ---- */

/* Eigenvalues of a symmetric matrix, ascending: Householder's reduction to tridiagonal form, then implicit QL shifts.
   `a` is destroyed. */
static inline void dense_tridiagonal(double *a, int n, double *diagonal, double *below) {
    for (int k = 0; k + 2 < n; k++) {
        double norm = 0, alpha, scale = 0;
        double *v = below; /* used as scratch beyond k */
        for (int i = k + 1; i < n; i++) norm += a[i * n + k] * a[i * n + k];
        norm = sqrt(norm);
        alpha = a[(k + 1) * n + k] > 0 ? -norm : norm;
        for (int i = k + 1; i < n; i++) v[i] = a[i * n + k];
        v[k + 1] -= alpha;
        for (int i = k + 1; i < n; i++) scale += v[i] * v[i];
        if (scale > 0) {
            double *p = diagonal, vp = 0; /* p = 2 A v / v.v */
            for (int i = k + 1; i < n; i++) {
                p[i] = 0;
                for (int j = k + 1; j < n; j++) p[i] += a[i * n + j] * v[j];
                p[i] *= 2 / scale;
                vp += v[i] * p[i];
            }
            for (int i = k + 1; i < n; i++) p[i] -= vp / scale * v[i];
            for (int i = k + 1; i < n; i++)
                for (int j = k + 1; j < n; j++) a[i * n + j] -= v[i] * p[j] + p[i] * v[j];
        }
        a[(k + 1) * n + k] = a[k * n + k + 1] = scale > 0 ? alpha : 0;
    }
    for (int i = 0; i < n; i++) diagonal[i] = a[i * n + i];
    for (int i = 0; i + 1 < n; i++) below[i] = a[(i + 1) * n + i];
    below[n - 1] = 0;
}

/* Eigenvalues of a tridiagonal matrix by bisection on Sturm sequences would do as well; QL is faster. */
static inline void tridiagonal_eigenvalues(double *d, double *e, int n) {
    for (int l = 0; l < n; l++)
        for (int sweep = 0; sweep < 60; sweep++) {
            int m = l;
            while (m + 1 < n && fabs(e[m]) > 1e-17 * (fabs(d[m]) + fabs(d[m + 1]))) m++;
            if (m == l) break;
            double g = (d[l + 1] - d[l]) / (2 * e[l]), r = hypot(g, 1), s = 1, c = 1, p = 0;
            g = d[m] - d[l] + e[l] / (g + (g < 0 ? -r : r));
            int i;
            for (i = m - 1; i >= l; i--) {
                double f = s * e[i], b = c * e[i];
                r = hypot(f, g);
                e[i + 1] = r;
                if (r == 0) {
                    d[i + 1] -= p;
                    e[m] = 0;
                    break;
                }
                s = f / r, c = g / r;
                g = d[i + 1] - p;
                r = (d[i] - g) * s + 2 * c * b;
                p = s * r;
                d[i + 1] = g + p;
                g = c * r - b;
            }
            if (r == 0 && i >= l) continue;
            d[l] -= p;
            e[l] = g;
            e[m] = 0;
        }
}

static inline int compare_reals(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

static inline void dense_eigenvalues(double *a, int n, double *values) {
    double *below = need_reals((size_t)n);
    dense_tridiagonal(a, n, values, below);
    tridiagonal_eigenvalues(values, below, n);
    qsort(values, (size_t)n, sizeof(double), compare_reals);
    free(below);
}

/* a := S a S with S = diag(a)^-1/2 */
static inline void dense_equilibrate(double *a, int n) {
    double *s = need_reals((size_t)n);
    for (int i = 0; i < n; i++) s[i] = 1 / sqrt(fabs(a[i * n + i]));
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) a[i * n + j] *= s[i] * s[j];
    free(s);
}

/* |largest| / |smallest| eigenvalue; *definite (may be NULL) tells whether all are positive. Keeps `a`. */
static inline double dense_condition(const double *a, int n, int equilibrate, int *definite) {
    double *copy = need_reals((size_t)n * (size_t)n), *values = need_reals((size_t)n), small, large;
    memcpy(copy, a, (size_t)n * (size_t)n * sizeof(double));
    if (equilibrate) dense_equilibrate(copy, n);
    dense_eigenvalues(copy, n, values);
    small = large = fabs(values[0]);
    for (int i = 1; i < n; i++) {
        if (fabs(values[i]) < small) small = fabs(values[i]);
        if (fabs(values[i]) > large) large = fabs(values[i]);
    }
    if (definite) *definite = values[0] > 0;
    free(copy);
    free(values);
    return large / small;
}

/* Solves a x = b by Gaussian elimination with pivoting, also for indefinite matrices; a and b are destroyed, b becomes
   x. 0 where a is singular. */
static inline int dense_solve(double *a, int n, double *b) {
    for (int k = 0; k < n; k++) {
        int pivot = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(a[i * n + k]) > fabs(a[pivot * n + k])) pivot = i;
        if (a[pivot * n + k] == 0) return 0;
        for (int j = 0; j < n && pivot != k; j++) {
            double swap = a[k * n + j];
            a[k * n + j] = a[pivot * n + j], a[pivot * n + j] = swap;
        }
        if (pivot != k) {
            double swap = b[k];
            b[k] = b[pivot], b[pivot] = swap;
        }
        for (int i = k + 1; i < n; i++) {
            double f = a[i * n + k] / a[k * n + k];
            if (f == 0) continue;
            for (int j = k; j < n; j++) a[i * n + j] -= f * a[k * n + j];
            b[i] -= f * b[k];
        }
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++) b[i] -= a[i * n + j] * b[j];
        b[i] /= a[i * n + i];
    }
    return 1;
}

/* ---- block matrices ---- */

/* The whole matrix, dense; to be freed. */
static inline double *matrix_dense(const dgfem_matrix *m) {
    size_t n = (size_t)m->size;
    double *a = need_reals(n * n);
    for (int r = 0; r < m->block_count; r++)
        for (int k = m->row_start[r]; k < m->row_start[r + 1]; k++) {
            int c = m->column[k], rows = m->offset[r + 1] - m->offset[r], columns = m->offset[c + 1] - m->offset[c];
            const double *block = m->values + m->value_start[k];
            for (int i = 0; i < rows; i++)
                for (int j = 0; j < columns; j++) {
                    size_t row = (size_t)(m->offset[r] + i), column = (size_t)(m->offset[c] + j);
                    a[row * n + column] = a[column * n + row] = block[i * columns + j];
                }
        }
    return a;
}

/* S m S with S = diag(m)^-1/2 in place; returns the diagonal of S, to be freed. */
static inline double *matrix_equilibrate(dgfem_matrix *m) {
    double *s = need_reals((size_t)m->size);
    for (int r = 0; r < m->block_count; r++) {
        const double *block = m->values + m->value_start[m->row_start[r + 1] - 1];
        int rows = m->offset[r + 1] - m->offset[r];
        for (int i = 0; i < rows; i++) s[m->offset[r] + i] = 1 / sqrt(fabs(block[i * rows + i]));
    }
    for (int r = 0; r < m->block_count; r++)
        for (int k = m->row_start[r]; k < m->row_start[r + 1]; k++) {
            int c = m->column[k], rows = m->offset[r + 1] - m->offset[r], columns = m->offset[c + 1] - m->offset[c];
            double *block = m->values + m->value_start[k];
            for (int i = 0; i < rows; i++)
                for (int j = 0; j < columns; j++) block[i * columns + j] *= s[m->offset[r] + i] * s[m->offset[c] + j];
        }
    return s;
}

/* A matrix of the same pattern and values. */
static inline dgfem_matrix *matrix_copy(const dgfem_matrix *m) {
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    dgfem_matrix *copy;
    int blocks = m->row_start[m->block_count], pair = 0;
    int *sizes = (int *)need_memory((size_t)m->block_count, sizeof *sizes);
    int *pairs = (int *)need_memory(2 * (size_t)blocks, sizeof *pairs);
    for (int r = 0; r < m->block_count; r++) {
        sizes[r] = m->offset[r + 1] - m->offset[r];
        for (int k = m->row_start[r]; k < m->row_start[r + 1]; k++) pairs[pair++] = r, pairs[pair++] = m->column[k];
    }
    desc.block_count = m->block_count, desc.block_sizes = sizes;
    desc.pairs = pairs, desc.pair_count = blocks;
    desc.centres = m->centres;
    desc.hooks = paper_hooks();
    need(dgfem_matrix_create(&desc, &copy), "matrix");
    memcpy(copy->values, m->values, m->value_start[blocks] * sizeof(double));
    free(sizes);
    free(pairs);
    return copy;
}

/* Solves m x = b with the library's Cholesky factorization. 0 where m is not positive definite. */
static inline int matrix_solve(const dgfem_matrix *m, const double *b, double *x) {
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky;
    dgfem_status status;
    need(dgfem_cholesky_create(m, &desc, &cholesky), "Cholesky");
    status = dgfem_cholesky_factor(cholesky, m, NULL);
    if (!status) need(dgfem_cholesky_solve(cholesky, b, x), "Cholesky");
    else if (status != DGFEM_ERROR_NOT_POSITIVE_DEFINITE) need(status, "Cholesky");
    dgfem_cholesky_destroy(cholesky);
    return status == DGFEM_OK;
}

/* Numbers that are not zero to round-off, as a share of all size^2. */
static inline double matrix_share(const dgfem_matrix *m) {
    double *diagonal = need_reals((size_t)m->size), count = 0;
    for (int r = 0; r < m->block_count; r++) {
        const double *block = m->values + m->value_start[m->row_start[r + 1] - 1];
        int rows = m->offset[r + 1] - m->offset[r];
        for (int i = 0; i < rows; i++) diagonal[m->offset[r] + i] = fabs(block[i * rows + i]);
    }
    for (int r = 0; r < m->block_count; r++)
        for (int k = m->row_start[r]; k < m->row_start[r + 1]; k++) {
            int c = m->column[k], rows = m->offset[r + 1] - m->offset[r], columns = m->offset[c + 1] - m->offset[c];
            const double *block = m->values + m->value_start[k];
            for (int i = 0; i < rows; i++)
                for (int j = 0; j < columns; j++) {
                    double size = sqrt(diagonal[m->offset[r] + i] * diagonal[m->offset[c] + j]);
                    if (fabs(block[i * columns + j]) > 1e-13 * size) count += c == r ? 1 : 2;
                }
        }
    free(diagonal);
    return count / ((double)m->size * (double)m->size);
}

/* The largest eigenvalue of m, or with a factorization of 1 / m, by Lanczos with full orthogonalisation. */
static inline double lanczos_largest(const dgfem_matrix *m, const dgfem_cholesky *inverse) {
    enum { STEPS = 90 };
    int n = m->size, steps = 0;
    double *q = need_reals((size_t)(STEPS + 1) * (size_t)n), *w = need_reals((size_t)n);
    double alpha[STEPS] = {0}, beta[STEPS + 1] = {0}, norm = 0;
    unsigned seed = 12345;
    for (int i = 0; i < n; i++) {
        seed = seed * 1664525u + 1013904223u;
        q[i] = (double)(seed >> 8) / 16777216.0 - 0.5;
        norm += q[i] * q[i];
    }
    for (int i = 0; i < n; i++) q[i] /= sqrt(norm);
    for (int k = 0; k < STEPS && k < n; k++) {
        double *v = q + (size_t)k * (size_t)n, *next = v + n;
        if (inverse) need(dgfem_cholesky_solve(inverse, v, w), "Lanczos");
        else dgfem_matrix_multiply(m, v, w);
        alpha[k] = 0;
        for (int i = 0; i < n; i++) alpha[k] += v[i] * w[i];
        for (int pass = 0; pass < 2; pass++)
            for (int j = 0; j <= k; j++) {
                double dot = 0, *u = q + (size_t)j * (size_t)n;
                for (int i = 0; i < n; i++) dot += u[i] * w[i];
                for (int i = 0; i < n; i++) w[i] -= dot * u[i];
            }
        norm = 0;
        for (int i = 0; i < n; i++) norm += w[i] * w[i];
        beta[k] = sqrt(norm);
        steps = k + 1;
        if (beta[k] < 1e-12 * fabs(alpha[0])) break;
        for (int i = 0; i < n; i++) next[i] = w[i] / beta[k];
    }
    beta[steps - 1] = 0;
    tridiagonal_eigenvalues(alpha, beta, steps);
    norm = alpha[0];
    for (int k = 1; k < steps; k++)
        if (alpha[k] > norm) norm = alpha[k];
    free(q);
    free(w);
    return norm;
}

/* Spectral condition number: dense for small matrices, by Lanczos (correct to about 1 %) for large ones. With
   `equilibrate` that of S m S, S = diag(m)^-1/2. HUGE_VAL where m is not positive definite. */
static inline double matrix_condition(const dgfem_matrix *m, int equilibrate) {
    double condition = HUGE_VAL;
    if (m->size <= 400) {
        double *dense = matrix_dense(m);
        int definite;
        condition = dense_condition(dense, m->size, equilibrate, &definite);
        free(dense);
        return definite ? condition : HUGE_VAL;
    }
    dgfem_matrix *copy = matrix_copy(m);
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_cholesky *cholesky;
    if (equilibrate) free(matrix_equilibrate(copy));
    need(dgfem_cholesky_create(copy, &desc, &cholesky), "Cholesky");
    if (dgfem_cholesky_factor(cholesky, copy, NULL) == DGFEM_OK)
        condition = lanczos_largest(copy, NULL) * lanczos_largest(copy, cholesky);
    dgfem_cholesky_destroy(cholesky);
    dgfem_matrix_destroy(copy);
    return condition;
}

/* ---- quadrature ---- */

enum { GAUSS_MOST = 16 };

/* Gauss-Legendre points and weights on [0, 1]. */
static inline void gauss(int n, double *x, double *w) {
    for (int i = 0; i < n; i++) {
        double z = cos(3.14159265358979323846 * (i + 0.75) / (n + 0.5)), derivative = 1;
        for (int iteration = 0; iteration < 50; iteration++) {
            double p = 1, last = 0;
            for (int k = 1; k <= n; k++) {
                double next = ((2 * k - 1) * z * p - (k - 1) * last) / k;
                last = p, p = next;
            }
            derivative = n * (z * p - last) / (z * z - 1);
            z -= p / derivative;
            if (fabs(p / derivative) < 1e-16) break;
        }
        x[i] = 0.5 * (1 - z);
        w[i] = 1 / ((1 - z * z) * derivative * derivative);
    }
}

/* Called with a point and its weight. */
typedef void (*quadrature_fn)(void *user, dgfem_vec3 x, double weight);

/* n^3 points on the tetrahedron (a, b, c, d), exact for degree 2n - 3; the weight has the sign of the volume. */
static inline void quadrature_tetrahedron(dgfem_vec3 a, dgfem_vec3 b, dgfem_vec3 c, dgfem_vec3 d, int n,
                                          quadrature_fn fn, void *user) {
    double x[GAUSS_MOST], w[GAUSS_MOST];
    dgfem_vec3 u = vec3(b.x - a.x, b.y - a.y, b.z - a.z), v = vec3(c.x - a.x, c.y - a.y, c.z - a.z);
    dgfem_vec3 t = vec3(d.x - a.x, d.y - a.y, d.z - a.z);
    double volume = u.x * (v.y * t.z - v.z * t.y) + u.y * (v.z * t.x - v.x * t.z) + u.z * (v.x * t.y - v.y * t.x);
    gauss(n, x, w);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            for (int k = 0; k < n; k++) {
                double r = x[i], s = (1 - r) * x[j], q = (1 - r - s) * x[k];
                double weight = w[i] * w[j] * w[k] * (1 - r) * (1 - r - s) * volume;
                fn(user,
                   vec3(a.x + r * u.x + s * v.x + q * t.x, a.y + r * u.y + s * v.y + q * t.y,
                        a.z + r * u.z + s * v.z + q * t.z),
                   weight);
            }
}

/* The same over a polyhedron: tetrahedra from its centroid to the triangles of its faces. */
static inline void quadrature_polyhedron(const dgfem_polyhedron *p, int n, quadrature_fn fn, void *user) {
    dgfem_vec3 centre = dgfem_polyhedron_measure(p).centroid;
    for (int f = 0; f < p->face_count; f++) {
        int triangles[3 * 64], count;
        need(dgfem_polyhedron_triangulate_face(p, f, triangles, 64, &count), "triangulate");
        if (count > 64) need(DGFEM_ERROR_ARGUMENT, "a face of more than 64 triangles");
        for (int k = 0; k < count; k++)
            quadrature_tetrahedron(centre, p->vertices[triangles[3 * k]], p->vertices[triangles[3 * k + 1]],
                                   p->vertices[triangles[3 * k + 2]], n, fn, user);
    }
}

/* ---- meshes ---- */

static inline dgfem_mesh *grid_mesh(dgfem_vec3 lower, dgfem_vec3 upper, int nx, int ny, int nz) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_mesh *mesh;
    desc.lower = lower, desc.upper = upper;
    desc.cells[0] = nx, desc.cells[1] = ny, desc.cells[2] = nz;
    desc.hooks = paper_hooks();
    need(dgfem_mesh_create_grid(&desc, &mesh), "grid");
    return mesh;
}

/* 0 <= result < 1 */
static inline double random_number(unsigned long long *state) {
    *state = *state * 6364136223846793005ull + 1442695040888963407ull;
    return (double)(*state >> 11) / 9007199254740992.0;
}

/* The unit cube: n^3 cubes cut by n planes through random points, in random directions; nothing snaps, so slivers come
   about. Another sample gives other planes. */
static inline dgfem_mesh *cut_cubes(int n, int sample) {
    dgfem_mesh *mesh = grid_mesh(vec3(0, 0, 0), vec3(1, 1, 1), n, n, n);
    unsigned long long state = 12 + (unsigned long long)sample;
    (void)random_number(&state);
    for (int cut = 0; cut < n; cut++) {
        double v[6];
        for (int i = 0; i < 6; i++) v[i] = random_number(&state) - (i < 3 ? 0.5 : 0);
        double norm = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        double offset = (v[0] * v[3] + v[1] * v[4] + v[2] * v[5]) / norm;
        need(dgfem_mesh_split_plane(mesh, plane(v[0] / norm, v[1] / norm, v[2] / norm, offset), 0, NULL), "split");
    }
    return mesh;
}

/* Volume of the smallest element by that of the largest. */
static inline double volume_ratio(const dgfem_mesh *mesh) {
    double low = HUGE_VAL, high = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        double volume = mesh->elements[e].volume;
        if (volume < low) low = volume;
        if (volume > high) high = volume;
    }
    return low / high;
}

/* A box of nx * ny * nz cells of six tetrahedra each, all along the same diagonal (Kuhn). */
typedef struct kuhn {
    int vertex_count, tetrahedron_count;
    dgfem_vec3 *vertices; /* index i + (nx + 1) * (j + (ny + 1) * k) */
    int *tetrahedra;      /* four vertices each, positively oriented */
} kuhn;

static inline kuhn kuhn_create(dgfem_vec3 lower, dgfem_vec3 upper, int nx, int ny, int nz) {
    static const int order[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    static const int sign[6] = {1, -1, -1, 1, 1, -1};
    const int step[3] = {1, nx + 1, (nx + 1) * (ny + 1)};
    kuhn k;
    int *t;
    k.vertex_count = (nx + 1) * (ny + 1) * (nz + 1);
    k.tetrahedron_count = 6 * nx * ny * nz;
    k.vertices = (dgfem_vec3 *)need_memory((size_t)k.vertex_count, sizeof *k.vertices);
    k.tetrahedra = (int *)need_memory(4 * (size_t)k.tetrahedron_count, sizeof *k.tetrahedra);
    for (int v = 0; v < k.vertex_count; v++) {
        int i = v % (nx + 1), j = v / (nx + 1) % (ny + 1), l = v / step[2];
        k.vertices[v] = vec3(lower.x + (upper.x - lower.x) * i / nx, lower.y + (upper.y - lower.y) * j / ny,
                             lower.z + (upper.z - lower.z) * l / nz);
    }
    t = k.tetrahedra;
    for (int l = 0; l < nz; l++)
        for (int j = 0; j < ny; j++)
            for (int i = 0; i < nx; i++)
                for (int p = 0; p < 6; p++, t += 4) {
                    t[0] = i + (nx + 1) * (j + (ny + 1) * l);
                    for (int s = 0; s < 3; s++) t[s + 1] = t[s] + step[order[p][s]];
                    if (sign[p] > 0) continue;
                    int swap = t[1];
                    t[1] = t[2], t[2] = swap;
                }
    return k;
}

static inline void kuhn_free(kuhn *k) {
    free(k->vertices);
    free(k->tetrahedra);
}

static inline dgfem_mesh *kuhn_mesh(const kuhn *k) {
    dgfem_tetrahedra_desc desc = dgfem_default_tetrahedra_desc();
    dgfem_mesh *mesh;
    desc.vertices = dgfem_points_in_vec3(k->vertices, k->vertex_count);
    desc.tetrahedra = k->tetrahedra, desc.tetrahedron_count = k->tetrahedron_count;
    desc.hooks = paper_hooks();
    need(dgfem_mesh_create_tetrahedra(&desc, &mesh), "tetrahedra");
    return mesh;
}

/* Boundary faces on a plane; their number is *count. To be freed. */
static inline int *faces_on(const dgfem_mesh *mesh, dgfem_plane where, int *count) {
    int room = dgfem_mesh_faces_on_plane(mesh, where, 1e-9, NULL, 0);
    int *faces = (int *)need_memory((size_t)room, sizeof *faces);
    *count = dgfem_mesh_faces_on_plane(mesh, where, 1e-9, faces, room);
    return faces;
}

/* ---- bodies ---- */

/* Linear elasticity without warping and gravity. */
static inline dgfem_body_desc linear_desc(double young, double poisson) {
    dgfem_body_desc desc = dgfem_default_body_desc();
    desc.material.young = young, desc.material.poisson = poisson, desc.material.density = 1;
    desc.gravity = vec3(0, 0, 0);
    desc.warp = 0;
    desc.hooks = paper_hooks();
    return desc;
}

static inline dgfem_body *body_of(dgfem_body_desc desc, dgfem_mesh *mesh) {
    dgfem_body *body;
    desc.mesh = mesh;
    need(dgfem_body_create(&desc, &body), "body");
    return body;
}

static inline void hold_plane(dgfem_body *body, dgfem_plane where) {
    int count, *faces = faces_on(body->mesh, where, &count);
    need(dgfem_body_fix_faces(body, faces, count, vec3(0, 0, 0), NULL), "fix_faces");
    free(faces);
}

/* One linear solve. 0 where the matrix is not positive definite. */
static inline int solve_linear(dgfem_body *body, dgfem_step_info *info) {
    dgfem_static_desc desc = dgfem_default_static_desc();
    dgfem_step_info local;
    dgfem_status status = dgfem_body_solve_static(body, &desc, info ? info : &local);
    if (status == DGFEM_ERROR_NOT_POSITIVE_DEFINITE) return 0;
    need(status, "static solve");
    return 1;
}

/* Mean displacement of the boundary faces on a plane. */
static inline dgfem_vec3 mean_on(const dgfem_body *body, dgfem_plane where) {
    int count, *faces = faces_on(body->mesh, where, &count);
    dgfem_vec3 sum = vec3(0, 0, 0);
    double area = 0;
    for (int i = 0; i < count; i++) {
        double a = body->mesh->faces[faces[i]].area;
        dgfem_vec3 u = dgfem_body_face_displacement(body, faces[i]);
        sum = vec3(sum.x + a * u.x, sum.y + a * u.y, sum.z + a * u.z);
        area += a;
    }
    free(faces);
    return vec3(sum.x / area, sum.y / area, sum.z / area);
}

#endif
