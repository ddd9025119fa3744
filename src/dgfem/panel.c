#pragma once
#include "base.c"
/* Dense kernels of the sparse Cholesky factorization. A panel is what one supernode has of L: a lower triangle D over a
   rectangle B, of the same columns.

   It is stored in strips of DGFEM_STRIP rows, first those of D, then those of B, each padded with rows of zeros to whole
   strips. A strip holds one column after the other: element (r, k) is strip[k * DGFEM_STRIP + r]. So the operands of
   every product come in the order in which the innermost kernel reads them. D's diagonal holds the reciprocals of
   L's. */

#ifndef DGFEM_STRIP
#if DGFEM_REAL_IS_FLOAT || defined(__AVX__)
#define DGFEM_STRIP 8
#else
#define DGFEM_STRIP 4
#endif
#endif

enum {
    DGFEM_TILE = 4,            /* columns of a tile, which has the rows of a strip; divides DGFEM_STRIP */
    DGFEM_PANEL_COLUMNS = 256, /* columns that are factored before they update the rest; whole strips */
    DGFEM_UPDATE_COLUMNS = 128 /* columns that are updated together: their strips stay in cache; whole strips */
};

/* ---- tiles ---- */

static int dgfemi_strips(int rows) { return rows / DGFEM_STRIP + (rows % DGFEM_STRIP != 0); }

/* sum[c][r] = sum over k of a(r, k) b(c, k): the kernel that does nearly all the work. a and b point into strips. */
static void dgfemi_tile_product(const dgfem_real *a, const dgfem_real *b, int count,
                                dgfem_real sum[DGFEM_TILE * DGFEM_STRIP]) {
    dgfem_real s0[DGFEM_STRIP], s1[DGFEM_STRIP], s2[DGFEM_STRIP], s3[DGFEM_STRIP];
    int r;
    for (r = 0; r < DGFEM_STRIP; r++) s0[r] = s1[r] = s2[r] = s3[r] = 0;
    for (; count > 0; count--, a += DGFEM_STRIP, b += DGFEM_STRIP) {
        dgfem_real b0 = b[0], b1 = b[1], b2 = b[2], b3 = b[3];
        for (r = 0; r < DGFEM_STRIP; r++) {
            dgfem_real x = a[r];
            s0[r] += x * b0;
            s1[r] += x * b1;
            s2[r] += x * b2;
            s3[r] += x * b3;
        }
    }
    for (r = 0; r < DGFEM_STRIP; r++) {
        sum[r] = s0[r];
        sum[DGFEM_STRIP + r] = s1[r];
        sum[2 * DGFEM_STRIP + r] = s2[r];
        sum[3 * DGFEM_STRIP + r] = s3[r];
    }
}

/* x -= a b^T for a tile of `columns` columns. */
static void dgfemi_tile_subtract(const dgfem_real *a, const dgfem_real *b, int count, dgfem_real *x, int columns) {
    dgfem_real sum[DGFEM_TILE * DGFEM_STRIP];
    int i;
    if (count == 0) return;
    dgfemi_tile_product(a, b, count, sum);
    for (i = 0; i < columns * DGFEM_STRIP; i++) x[i] -= sum[i];
}

/* A pivot that round-off has left of the diagonal element of A carries no digit: such a matrix is singular to working
   precision, and the pivot counts as not positive. */
#define DGFEM_PIVOT_THRESHOLD ((dgfem_real)(8 * DGFEM_EPSILON))

/* Cholesky of the square part of a tile on the diagonal, whose first column is row `offset` of the strip; solves for
   the rows below. Returns the column whose pivot fails, or DGFEM_NONE. */
static int dgfemi_tile_cholesky(dgfem_real *x, int columns, int offset, const dgfem_real *diagonal) {
    int c, d, r;
    for (c = 0; c < columns; c++) {
        dgfem_real *xc = x + c * DGFEM_STRIP;
        dgfem_real pivot = xc[offset + c], reciprocal;
        if (!(pivot > DGFEM_PIVOT_THRESHOLD * dgfemi_abs(diagonal[c])) || !dgfemi_is_finite(pivot)) return c;
        reciprocal = 1 / dgfemi_sqrt(pivot);
        for (r = 0; r < DGFEM_STRIP; r++) xc[r] = r < offset + c ? 0 : xc[r] * reciprocal;
        for (d = c + 1; d < columns; d++) {
            dgfem_real factor = xc[offset + d];
            for (r = 0; r < DGFEM_STRIP; r++) x[d * DGFEM_STRIP + r] -= factor * xc[r];
        }
        xc[offset + c] = reciprocal;
    }
    return DGFEM_NONE;
}

/* x = x T^-T, T the square part of a tile on the diagonal. */
static void dgfemi_tile_solve(dgfem_real *x, int columns, const dgfem_real *t) {
    int c, d, r;
    for (c = 0; c < columns; c++) {
        dgfem_real *xc = x + c * DGFEM_STRIP;
        for (r = 0; r < DGFEM_STRIP; r++) xc[r] *= t[c * DGFEM_STRIP + c];
        for (d = c + 1; d < columns; d++) {
            dgfem_real factor = t[c * DGFEM_STRIP + d];
            for (r = 0; r < DGFEM_STRIP; r++) x[d * DGFEM_STRIP + r] -= factor * xc[r];
        }
    }
}

/* ---- panels ---- */

typedef struct dgfemi_panel {
    dgfem_real *values;
    int width, height;
} dgfemi_panel;

static int dgfemi_panel_strips(const dgfemi_panel *p) { return dgfemi_strips(p->width) + dgfemi_strips(p->height); }

static dgfem_real *dgfemi_strip(const dgfemi_panel *p, int strip) {
    return p->values + (size_t)strip * DGFEM_STRIP * (size_t)p->width;
}

/* Row `row` of D, from column `column` on: the second operand of a product. */
static const dgfem_real *dgfemi_pivot_row(const dgfemi_panel *p, int row, int column) {
    return dgfemi_strip(p, row / DGFEM_STRIP) + (size_t)column * DGFEM_STRIP + row % DGFEM_STRIP;
}

/* The column that a strip's columns end before: those of D end at the diagonal. */
static int dgfemi_strip_end(const dgfemi_panel *p, int strip, int limit) {
    int end = strip < dgfemi_strips(p->width) ? (strip + 1) * DGFEM_STRIP : p->width;
    if (end > p->width) end = p->width;
    return end < limit ? end : limit;
}

static int dgfemi_tile_columns(int column, int end) { return end - column < DGFEM_TILE ? end - column : DGFEM_TILE; }

/* ---- factorization ---- */

/* Columns from <= k < to of one strip of L, those before `from` being done with. The rows of D that they meet are
   finished. Returns the column whose pivot fails, or DGFEM_NONE. */
static int dgfemi_factor_strip(const dgfemi_panel *p, int strip, int from, int to, const dgfem_real *diagonal) {
    dgfem_real *values = dgfemi_strip(p, strip);
    int end = dgfemi_strip_end(p, strip, to), j;
    for (j = from; j < end; j += DGFEM_TILE) {
        dgfem_real *x = values + (size_t)j * DGFEM_STRIP;
        int columns = dgfemi_tile_columns(j, end);
        dgfemi_tile_subtract(values + (size_t)from * DGFEM_STRIP, dgfemi_pivot_row(p, j, from), j - from, x, columns);
        if (strip == j / DGFEM_STRIP) {
            int failed = dgfemi_tile_cholesky(x, columns, j % DGFEM_STRIP, diagonal + j);
            if (failed != DGFEM_NONE) return j + failed;
        } else dgfemi_tile_solve(x, columns, dgfemi_pivot_row(p, j, j));
    }
    return DGFEM_NONE;
}

/* Subtracts from the columns from `to` on what the columns from <= k < to contribute. */
static void dgfemi_update_panel(const dgfemi_panel *p, int from, int to) {
    int strips = dgfemi_panel_strips(p), chunk, strip, j;
    for (chunk = to; chunk < p->width; chunk += DGFEM_UPDATE_COLUMNS)
        for (strip = chunk / DGFEM_STRIP; strip < strips; strip++) {
            dgfem_real *values = dgfemi_strip(p, strip);
            int end = dgfemi_strip_end(p, strip, chunk + DGFEM_UPDATE_COLUMNS);
            for (j = chunk; j < end; j += DGFEM_TILE)
                dgfemi_tile_subtract(values + (size_t)from * DGFEM_STRIP, dgfemi_pivot_row(p, j, from), to - from,
                                     values + (size_t)j * DGFEM_STRIP, dgfemi_tile_columns(j, end));
        }
}

/* D = L L^T, B = B L^-T. Returns the column whose pivot fails, or DGFEM_NONE. */
static int dgfemi_factor_panel(const dgfemi_panel *p, const dgfem_real *diagonal) {
    int strips = dgfemi_panel_strips(p), from, strip;
    for (from = 0; from < p->width; from += DGFEM_PANEL_COLUMNS) {
        int to = p->width - from < DGFEM_PANEL_COLUMNS ? p->width : from + DGFEM_PANEL_COLUMNS;
        for (strip = from / DGFEM_STRIP; strip < strips; strip++) {
            int failed = dgfemi_factor_strip(p, strip, from, to, diagonal);
            if (failed != DGFEM_NONE) return failed;
        }
        dgfemi_update_panel(p, from, to);
    }
    return DGFEM_NONE;
}

/* Element (i, j), i >= j, of a packed lower half with n rows is [dgfemi_packed(n, j) + i]. */
static size_t dgfemi_packed(int n, int j) { return (size_t)j * (size_t)(2 * (ptrdiff_t)n - j - 1) / 2; }

/* Element (i, j) of U, with i the tile's row: = or += -sum. */
static void dgfemi_store_tile(dgfem_real *u, int height, int row, int column, const dgfem_real *sum, int add) {
    int columns = dgfemi_tile_columns(column, height), rows = height - row < DGFEM_STRIP ? height - row : DGFEM_STRIP;
    int c, r;
    for (c = 0; c < columns; c++, sum += DGFEM_STRIP) {
        dgfem_real *to = u + dgfemi_packed(height, column + c) + row;
        int first = column + c > row ? column + c - row : 0;
        if (first == 0 && rows == DGFEM_STRIP) {
            if (add)
                for (r = 0; r < DGFEM_STRIP; r++) to[r] -= sum[r];
            else
                for (r = 0; r < DGFEM_STRIP; r++) to[r] = -sum[r];
        } else
            for (r = first; r < rows; r++) to[r] = (add ? to[r] : 0) - sum[r];
    }
}

/* U = -B B^T, lower half. */
static void dgfemi_make_update(const dgfemi_panel *p, dgfem_real *u) {
    int pivot_strips = dgfemi_strips(p->width), strips = dgfemi_strips(p->height), from, chunk, strip, j;
    dgfem_real sum[DGFEM_TILE * DGFEM_STRIP];
    for (from = 0; from < p->width; from += DGFEM_PANEL_COLUMNS) {
        int count = p->width - from < DGFEM_PANEL_COLUMNS ? p->width - from : DGFEM_PANEL_COLUMNS;
        for (chunk = 0; chunk < p->height; chunk += DGFEM_UPDATE_COLUMNS)
            for (strip = chunk / DGFEM_STRIP; strip < strips; strip++) {
                const dgfem_real *a = dgfemi_strip(p, pivot_strips + strip) + (size_t)from * DGFEM_STRIP;
                int end = (strip + 1) * DGFEM_STRIP;
                if (end > chunk + DGFEM_UPDATE_COLUMNS) end = chunk + DGFEM_UPDATE_COLUMNS;
                if (end > p->height) end = p->height;
                for (j = chunk; j < end; j += DGFEM_TILE) {
                    const dgfem_real *b = dgfemi_pivot_row(p, pivot_strips * DGFEM_STRIP + j, from);
                    dgfemi_tile_product(a, b, count, sum);
                    dgfemi_store_tile(u, p->height, strip * DGFEM_STRIP, j, sum, from > 0);
                }
            }
    }
}

/* Fills the strips from a column-major array of width + height rows; what lies above D's diagonal strips is never
   used. */
static void dgfemi_pack_panel(const dgfemi_panel *p, const dgfem_real *columns) {
    int pivot_strips = dgfemi_strips(p->width), strips = dgfemi_panel_strips(p), strip, k, r;
    size_t stride = (size_t)p->width + (size_t)p->height;
    for (strip = 0; strip < strips; strip++) {
        dgfem_real *to = dgfemi_strip(p, strip);
        int below = strip >= pivot_strips;
        int row = below ? (strip - pivot_strips) * DGFEM_STRIP : strip * DGFEM_STRIP;
        int rows = (below ? p->height : p->width) - row, end = dgfemi_strip_end(p, strip, p->width);
        const dgfem_real *from = columns + (below ? p->width + row : row);
        for (k = 0; k < end; k++, from += stride, to += DGFEM_STRIP) {
            if (rows >= DGFEM_STRIP)
                for (r = 0; r < DGFEM_STRIP; r++) to[r] = from[r];
            else
                for (r = 0; r < DGFEM_STRIP; r++) to[r] = r < rows ? from[r] : 0;
        }
    }
}

/* ---- solves ---- */

/* y += x */
static void dgfemi_add_vector(dgfem_real *y, const dgfem_real *x, int count) {
    dgfem_real sum[4];
    int i = 0, k;
    for (; i + 4 <= count; i += 4) {
        for (k = 0; k < 4; k++) sum[k] = y[i + k] + x[i + k];
        for (k = 0; k < 4; k++) y[i + k] = sum[k];
    }
    for (; i < count; i++) y[i] += x[i];
}

/* sum[r] -= sum over k of strip(r, k) x[k] */
static void dgfemi_strip_subtract(const dgfem_real *strip, int columns, const dgfem_real *x,
                                  dgfem_real sum[DGFEM_STRIP]) {
    dgfem_real even[DGFEM_STRIP] = {0}, odd[DGFEM_STRIP] = {0};
    int k = 0, r;
    for (; k + 2 <= columns; k += 2, strip += 2 * DGFEM_STRIP) {
        dgfem_real x0 = x[k], x1 = x[k + 1];
        for (r = 0; r < DGFEM_STRIP; r++) {
            even[r] += strip[r] * x0;
            odd[r] += strip[DGFEM_STRIP + r] * x1;
        }
    }
    if (k < columns)
        for (r = 0; r < DGFEM_STRIP; r++) even[r] += strip[r] * x[k];
    for (r = 0; r < DGFEM_STRIP; r++) sum[r] -= even[r] + odd[r];
}

/* x[k] -= sum over r of strip(r, k) y[r] */
static void dgfemi_strip_subtract_transposed(const dgfem_real *strip, int columns, const dgfem_real y[DGFEM_STRIP],
                                             dgfem_real *x) {
    int k, r;
    for (k = 0; k < columns; k++, strip += DGFEM_STRIP) {
        dgfem_real sum[4] = {0};
        for (r = 0; r < DGFEM_STRIP; r++) sum[r % 4] += strip[r] * y[r];
        x[k] -= (sum[0] + sum[1]) + (sum[2] + sum[3]);
    }
}

/* x = L^-1 x for a supernode's own unknowns; below = -B x. */
static void dgfemi_solve_panel(const dgfemi_panel *p, dgfem_real *x, dgfem_real *below) {
    int pivot_strips = dgfemi_strips(p->width), strips = dgfemi_panel_strips(p), strip, c, r;
    for (strip = 0; strip < pivot_strips; strip++) {
        int first = strip * DGFEM_STRIP, columns = dgfemi_strip_end(p, strip, p->width) - first;
        const dgfem_real *triangle = dgfemi_strip(p, strip) + (size_t)first * DGFEM_STRIP;
        dgfem_real y[DGFEM_STRIP] = {0};
        for (r = 0; r < columns; r++) y[r] = x[first + r];
        dgfemi_strip_subtract(dgfemi_strip(p, strip), first, x, y);
        for (c = 0; c < columns; c++, triangle += DGFEM_STRIP) {
            y[c] *= triangle[c];
            for (r = c + 1; r < columns; r++) y[r] -= triangle[r] * y[c];
        }
        for (r = 0; r < columns; r++) x[first + r] = y[r];
    }
    for (; strip < strips; strip++, below += DGFEM_STRIP) {
        for (r = 0; r < DGFEM_STRIP; r++) below[r] = 0;
        dgfemi_strip_subtract(dgfemi_strip(p, strip), p->width, x, below);
    }
}

/* x = L^-T (x - B^T below) */
static void dgfemi_solve_panel_transposed(const dgfemi_panel *p, dgfem_real *x, const dgfem_real *below) {
    int pivot_strips = dgfemi_strips(p->width), strips = dgfemi_panel_strips(p), strip, c, r;
    for (strip = pivot_strips; strip < strips; strip++, below += DGFEM_STRIP)
        dgfemi_strip_subtract_transposed(dgfemi_strip(p, strip), p->width, below, x);
    for (strip = pivot_strips - 1; strip >= 0; strip--) {
        int first = strip * DGFEM_STRIP, columns = dgfemi_strip_end(p, strip, p->width) - first;
        const dgfem_real *triangle = dgfemi_strip(p, strip) + (size_t)first * DGFEM_STRIP;
        dgfem_real y[DGFEM_STRIP] = {0};
        for (c = columns - 1; c >= 0; c--) {
            const dgfem_real *column = triangle + c * DGFEM_STRIP;
            y[c] = x[first + c];
            for (r = c + 1; r < columns; r++) y[c] -= column[r] * y[r];
            y[c] *= column[c];
        }
        for (r = 0; r < columns; r++) x[first + r] = y[r];
        dgfemi_strip_subtract_transposed(dgfemi_strip(p, strip), first, y, x);
    }
}
