/* Dense kernels of the sparse Cholesky factorization, of products with blocks and of assembly, written once: this part
   is inserted for each instruction set, which panel.c describes by

       DGFEM_PATH(name)                       the name with the instruction set's suffix
       DGFEM_FOUR(name)                       the same, or that of one whose vectors have no more than four lanes
       DGFEM_VECTOR, DGFEM_V_LANES              its vector of reals, and their number
       DGFEM_VECTORS, DGFEM_TILE              vectors in a strip, columns of a tile (even; divides a strip's rows)
       DGFEM_V_LOAD(p) _STORE(p, v) _ALL(x)   and _ADD(a, b), _SUB(a, b), _MUL(a, b)
       DGFEM_V_FMA(a, b, c) _FNMA(a, b, c)    a b + c, c - a b

   A strip is DGFEM_STRIP rows of a matrix, one column after the other: element (r, k) is strip[k * DGFEM_STRIP + r]. So
   both operands of every product come in the order in which the innermost loop reads them: A's tile as vectors, B's as
   single numbers. Rows that fill up the last strip of a matrix are zeros.

   The functions that end in `tile` work on `columns` columns and on the vectors from `first` to the end of a strip with
   `vectors` of them: those above a diagonal, and those that only fill up, are left out. */

#define DGFEM_STRIP (DGFEM_V_LANES * DGFEM_VECTORS)

/* ---- tiles ---- */

/* sum[c * vectors + v] = sum over k of a(v, k) b(c, k): the loop that does nearly all the work of a factorization. */
DGFEM_INLINE void DGFEM_PATH(dgfemi_multiply)(const dgfem_real *a, const dgfem_real *b, int count, int vectors,
                                              int columns, DGFEM_VECTOR *sum) {
    int c, v;
    DGFEM_UNROLL
    for (c = 0; c < columns; c++) {
        DGFEM_UNROLL
        for (v = 0; v < vectors; v++) sum[c * vectors + v] = DGFEM_V_ALL(0);
    }
    DGFEM_ROLLED
    for (; count > 0; count--, a += DGFEM_STRIP, b += DGFEM_STRIP) {
        DGFEM_VECTOR x[DGFEM_VECTORS];
        DGFEM_UNROLL
        for (v = 0; v < vectors; v++) x[v] = DGFEM_V_LOAD(a + v * DGFEM_V_LANES);
        DGFEM_UNROLL
        for (c = 0; c < columns; c++) {
            DGFEM_VECTOR y = DGFEM_V_ALL(b[c]);
            DGFEM_UNROLL
            for (v = 0; v < vectors; v++) sum[c * vectors + v] = DGFEM_V_FMA(x[v], y, sum[c * vectors + v]);
        }
    }
}

/* x -= a b^T; then, unless t is NULL, x = x T^-T, T the square part of a tile on the diagonal. */
DGFEM_INLINE void DGFEM_PATH(dgfemi_subtract)(const dgfem_real *a, const dgfem_real *b, int count, dgfem_real *x,
                                              const dgfem_real *t, int vectors, int columns) {
    DGFEM_VECTOR sum[DGFEM_TILE * DGFEM_VECTORS];
    int c, d, v;
    DGFEM_PATH(dgfemi_multiply)(a, b, count, vectors, columns, sum);
    DGFEM_UNROLL
    for (c = 0; c < columns; c++) {
        DGFEM_UNROLL
        for (v = 0; v < vectors; v++)
            sum[c * vectors + v] =
                DGFEM_V_SUB(DGFEM_V_LOAD(x + c * DGFEM_STRIP + v * DGFEM_V_LANES), sum[c * vectors + v]);
    }
    DGFEM_UNROLL
    for (c = 0; c < columns; c++) {
        if (t) {
            DGFEM_VECTOR reciprocal = DGFEM_V_ALL(t[c * DGFEM_STRIP + c]);
            DGFEM_UNROLL
            for (v = 0; v < vectors; v++) sum[c * vectors + v] = DGFEM_V_MUL(sum[c * vectors + v], reciprocal);
            DGFEM_UNROLL
            for (d = c + 1; d < columns; d++) {
                DGFEM_VECTOR factor = DGFEM_V_ALL(t[c * DGFEM_STRIP + d]);
                DGFEM_UNROLL
                for (v = 0; v < vectors; v++)
                    sum[d * vectors + v] = DGFEM_V_FNMA(sum[c * vectors + v], factor, sum[d * vectors + v]);
            }
        }
        DGFEM_UNROLL
        for (v = 0; v < vectors; v++)
            DGFEM_V_STORE(x + c * DGFEM_STRIP + v * DGFEM_V_LANES, sum[c * vectors + v]);
    }
}

/* u = -a b^T, or with `add` u -= a b^T. */
DGFEM_INLINE void DGFEM_PATH(dgfemi_store)(const dgfem_real *a, const dgfem_real *b, int count, dgfem_real *u, int add,
                                           int vectors, int columns) {
    DGFEM_VECTOR sum[DGFEM_TILE * DGFEM_VECTORS];
    int c, v;
    DGFEM_PATH(dgfemi_multiply)(a, b, count, vectors, columns, sum);
    DGFEM_UNROLL
    for (c = 0; c < columns; c++) {
        DGFEM_UNROLL
        for (v = 0; v < vectors; v++) {
            dgfem_real *to = u + c * DGFEM_STRIP + v * DGFEM_V_LANES;
            DGFEM_V_STORE(to, DGFEM_V_SUB(add ? DGFEM_V_LOAD(to) : DGFEM_V_ALL(0), sum[c * vectors + v]));
        }
    }
}

/* Calls a kernel with constants for the vectors from `first` to `vectors` and for whole or half tiles. */
#if DGFEM_VECTORS > 2
#define DGFEM_CASE_3(call, columns) case 3: call(3, columns); break;
#else
#define DGFEM_CASE_3(call, columns)
#endif
#if DGFEM_VECTORS > 3
#define DGFEM_CASE_4(call, columns) case 4: call(4, columns); break;
#else
#define DGFEM_CASE_4(call, columns)
#endif
#define DGFEM_SWITCH(vectors, call, columns) \
    switch (vectors) {                       \
    case 1: call(1, columns); break;         \
    case 2: call(2, columns); break;         \
    DGFEM_CASE_3(call, columns)              \
    DGFEM_CASE_4(call, columns)              \
    default: break;                          \
    }

/* The same for any number of columns; the tile's other columns are computed and dropped. */
static void DGFEM_PATH(dgfemi_subtract_part)(const dgfem_real *a, const dgfem_real *b, int count, dgfem_real *x,
                                             const dgfem_real *t, int vectors, int columns) {
    DGFEM_VECTOR sum[DGFEM_TILE * DGFEM_VECTORS], *s = sum;
    int c, d, v;
#define DGFEM_CALL(n, m) DGFEM_PATH(dgfemi_multiply)(a, b, count, n, m, sum)
    DGFEM_SWITCH(vectors, DGFEM_CALL, DGFEM_TILE)
#undef DGFEM_CALL
    for (c = 0; c < columns; c++, s += vectors)
        for (v = 0; v < vectors; v++) s[v] = DGFEM_V_SUB(DGFEM_V_LOAD(x + c * DGFEM_STRIP + v * DGFEM_V_LANES), s[v]);
    for (c = 0, s = sum; c < columns; c++, s += vectors) {
        for (v = 0; t && v < vectors; v++) s[v] = DGFEM_V_MUL(s[v], DGFEM_V_ALL(t[c * DGFEM_STRIP + c]));
        for (d = c + 1; t && d < columns; d++)
            for (v = 0; v < vectors; v++)
                sum[d * vectors + v] = DGFEM_V_FNMA(s[v], DGFEM_V_ALL(t[c * DGFEM_STRIP + d]), sum[d * vectors + v]);
        for (v = 0; v < vectors; v++) DGFEM_V_STORE(x + c * DGFEM_STRIP + v * DGFEM_V_LANES, s[v]);
    }
}

static void DGFEM_PATH(dgfemi_subtract_tile)(const dgfem_real *a, const dgfem_real *b, int count, dgfem_real *x,
                                             int first, int vectors, int columns) {
    if (count == 0) return;
    a += first * DGFEM_V_LANES;
    x += first * DGFEM_V_LANES;
#define DGFEM_CALL(n, m) DGFEM_PATH(dgfemi_subtract)(a, b, count, x, NULL, n, m)
    if (columns == DGFEM_TILE) DGFEM_SWITCH(vectors - first, DGFEM_CALL, DGFEM_TILE)
    else if (columns == DGFEM_TILE / 2) DGFEM_SWITCH(vectors - first, DGFEM_CALL, DGFEM_TILE / 2)
    else DGFEM_PATH(dgfemi_subtract_part)(a, b, count, x, NULL, vectors - first, columns);
#undef DGFEM_CALL
}

static void DGFEM_PATH(dgfemi_solve_tile)(const dgfem_real *a, const dgfem_real *b, int count, dgfem_real *x,
                                          const dgfem_real *t, int vectors, int columns) {
#define DGFEM_CALL(n, m) DGFEM_PATH(dgfemi_subtract)(a, b, count, x, t, n, m)
    if (columns == DGFEM_TILE) DGFEM_SWITCH(vectors, DGFEM_CALL, DGFEM_TILE)
    else if (columns == DGFEM_TILE / 2) DGFEM_SWITCH(vectors, DGFEM_CALL, DGFEM_TILE / 2)
    else DGFEM_PATH(dgfemi_subtract_part)(a, b, count, x, t, vectors, columns);
#undef DGFEM_CALL
}

/* May write the whole tile, or half of it where `columns` are no more. */
static void DGFEM_PATH(dgfemi_store_tile)(const dgfem_real *a, const dgfem_real *b, int count, dgfem_real *u, int add,
                                          int first, int vectors, int columns) {
    a += first * DGFEM_V_LANES;
    u += first * DGFEM_V_LANES;
#define DGFEM_CALL(n, m) DGFEM_PATH(dgfemi_store)(a, b, count, u, add, n, m)
    if (columns > DGFEM_TILE / 2) DGFEM_SWITCH(vectors - first, DGFEM_CALL, DGFEM_TILE)
    else DGFEM_SWITCH(vectors - first, DGFEM_CALL, DGFEM_TILE / 2)
#undef DGFEM_CALL
}

/* Cholesky of the square part of a tile on the diagonal, whose first column is row `offset` of the strip; solves for
   the rows below. Returns the column whose pivot fails, or DGFEM_NONE. */
static int DGFEM_PATH(dgfemi_factor_tile)(dgfem_real *x, int columns, int offset, int vectors,
                                          const dgfem_real *diagonal) {
    int c, d, r, v;
    for (c = 0; c < columns; c++) {
        dgfem_real *xc = x + c * DGFEM_STRIP;
        dgfem_real pivot = xc[offset + c], reciprocal;
        if (!dgfemi_pivot_is_good(pivot, diagonal[c])) return c;
        reciprocal = 1 / dgfemi_sqrt(pivot);
        for (r = 0; r < offset + c; r++) xc[r] = 0;
        for (v = (offset + c) / DGFEM_V_LANES; v < vectors; v++) {
            DGFEM_VECTOR scaled = DGFEM_V_MUL(DGFEM_V_LOAD(xc + v * DGFEM_V_LANES), DGFEM_V_ALL(reciprocal));
            DGFEM_V_STORE(xc + v * DGFEM_V_LANES, scaled);
        }
        for (d = c + 1; d < columns; d++) {
            DGFEM_VECTOR factor = DGFEM_V_ALL(xc[offset + d]);
            for (v = (offset + d) / DGFEM_V_LANES; v < vectors; v++) {
                dgfem_real *xd = x + d * DGFEM_STRIP + v * DGFEM_V_LANES;
                DGFEM_V_STORE(xd, DGFEM_V_FNMA(DGFEM_V_LOAD(xc + v * DGFEM_V_LANES), factor, DGFEM_V_LOAD(xd)));
            }
        }
        xc[offset + c] = reciprocal;
    }
    return DGFEM_NONE;
}

/* ---- panels ---- */

static int DGFEM_PATH(dgfemi_strips)(int rows) { return rows / DGFEM_STRIP + (rows % DGFEM_STRIP != 0); }

/* Where strip `strip` of a lower triangle begins: it has all columns up to its own last row, the strips before it
   likewise. */
static size_t DGFEM_PATH(dgfemi_triangle_strip)(int strip) {
    return (size_t)strip * ((size_t)strip + 1) / 2 * DGFEM_STRIP * DGFEM_STRIP;
}

/* D's last strip ends with the last column, as all those of B do. */
static dgfem_real *DGFEM_PATH(dgfemi_strip)(const dgfemi_panel *p, int strip) {
    int last = DGFEM_PATH(dgfemi_strips)(p->width) - 1;
    if (strip <= last) return p->values + DGFEM_PATH(dgfemi_triangle_strip)(strip);
    return p->values + DGFEM_PATH(dgfemi_triangle_strip)(last) + (size_t)(strip - last) * DGFEM_STRIP * (size_t)p->width;
}

/* Row `row` of D, or behind D's strips of B, from column `column` on: the second operand of a product. */
static const dgfem_real *DGFEM_PATH(dgfemi_panel_row)(const dgfemi_panel *p, int row, int column) {
    return DGFEM_PATH(dgfemi_strip)(p, row / DGFEM_STRIP) + (size_t)column * DGFEM_STRIP + row % DGFEM_STRIP;
}

/* Vectors that hold the rows of a matrix from `row` on which are in one strip. */
static int DGFEM_PATH(dgfemi_strip_vectors)(int rows, int row) {
    return rows - row >= DGFEM_STRIP ? DGFEM_VECTORS : (rows - row + DGFEM_V_LANES - 1) / DGFEM_V_LANES;
}

static int DGFEM_PATH(dgfemi_panel_vectors)(const dgfemi_panel *p, int strip) {
    int pivot_strips = DGFEM_PATH(dgfemi_strips)(p->width);
    return strip < pivot_strips ? DGFEM_PATH(dgfemi_strip_vectors)(p->width, strip * DGFEM_STRIP)
                                : DGFEM_PATH(dgfemi_strip_vectors)(p->height, (strip - pivot_strips) * DGFEM_STRIP);
}

/* The column that a strip's columns end before: those of D end at the diagonal. */
static int DGFEM_PATH(dgfemi_strip_end)(const dgfemi_panel *p, int strip, int limit) {
    int end = strip < DGFEM_PATH(dgfemi_strips)(p->width) ? (strip + 1) * DGFEM_STRIP : p->width;
    if (end > p->width) end = p->width;
    return end < limit ? end : limit;
}

static int DGFEM_PATH(dgfemi_tile_columns)(int column, int end) {
    return end - column < DGFEM_TILE ? end - column : DGFEM_TILE;
}

/* Columns from <= k < to of one strip of L, those before `from` being done with. The rows of D that they meet are
   finished. Returns the column whose pivot fails, or DGFEM_NONE. */
static int DGFEM_PATH(dgfemi_factor_strip)(const dgfemi_panel *p, int strip, int from, int to,
                                           const dgfem_real *diagonal) {
    dgfem_real *values = DGFEM_PATH(dgfemi_strip)(p, strip);
    const dgfem_real *a = values + (size_t)from * DGFEM_STRIP;
    int end = DGFEM_PATH(dgfemi_strip_end)(p, strip, to), vectors = DGFEM_PATH(dgfemi_panel_vectors)(p, strip), j;
    for (j = from; j < end; j += DGFEM_TILE) {
        dgfem_real *x = values + (size_t)j * DGFEM_STRIP;
        const dgfem_real *b = DGFEM_PATH(dgfemi_panel_row)(p, j, from);
        int columns = DGFEM_PATH(dgfemi_tile_columns)(j, end), offset = j % DGFEM_STRIP, failed;
        if (strip != j / DGFEM_STRIP) {
            DGFEM_PATH(dgfemi_solve_tile)(a, b, j - from, x, b + (size_t)(j - from) * DGFEM_STRIP, vectors, columns);
            continue;
        }
        DGFEM_PATH(dgfemi_subtract_tile)(a, b, j - from, x, offset / DGFEM_V_LANES, vectors, columns);
        failed = DGFEM_PATH(dgfemi_factor_tile)(x, columns, offset, vectors, diagonal + j);
        if (failed != DGFEM_NONE) return j + failed;
    }
    return DGFEM_NONE;
}

static int DGFEM_PATH(dgfemi_factor_strips)(const dgfemi_panel *p, int first, int last, int from, int to,
                                            const dgfem_real *diagonal) {
    int strip;
    for (strip = first; strip < last; strip++) {
        int failed = DGFEM_PATH(dgfemi_factor_strip)(p, strip, from, to, diagonal);
        if (failed != DGFEM_NONE) return failed;
    }
    return DGFEM_NONE;
}

/* Subtracts from the columns from `to` on what the columns from <= k < to contribute. */
static void DGFEM_PATH(dgfemi_update_strips)(const dgfemi_panel *p, int first, int last, int from, int to) {
    int chunk, strip, j;
    for (chunk = to; chunk < p->width; chunk += DGFEM_UPDATE_COLUMNS)
        for (strip = first; strip < last; strip++) {
            dgfem_real *values = DGFEM_PATH(dgfemi_strip)(p, strip);
            int end = DGFEM_PATH(dgfemi_strip_end)(p, strip, chunk + DGFEM_UPDATE_COLUMNS);
            int vectors = DGFEM_PATH(dgfemi_panel_vectors)(p, strip);
            for (j = chunk; j < end; j += DGFEM_TILE)
                DGFEM_PATH(dgfemi_subtract_tile)(values + (size_t)from * DGFEM_STRIP,
                                                 DGFEM_PATH(dgfemi_panel_row)(p, j, from), to - from,
                                                 values + (size_t)j * DGFEM_STRIP,
                                                 strip == j / DGFEM_STRIP ? j % DGFEM_STRIP / DGFEM_V_LANES : 0, vectors,
                                                 DGFEM_PATH(dgfemi_tile_columns)(j, end));
        }
}

/* U = -B B^T, lower half, the strips first <= i < last of it. What is above the diagonal stays undefined. */
static void DGFEM_PATH(dgfemi_make_update)(const dgfemi_panel *p, dgfem_real *u, int first, int last) {
    int pivot_strips = DGFEM_PATH(dgfemi_strips)(p->width), from, chunk, strip, j;
    for (from = 0; from < p->width; from += DGFEM_PANEL_COLUMNS) {
        int count = p->width - from < DGFEM_PANEL_COLUMNS ? p->width - from : DGFEM_PANEL_COLUMNS;
        for (chunk = 0; chunk < last * DGFEM_STRIP; chunk += DGFEM_UPDATE_COLUMNS)
            for (strip = first; strip < last; strip++) {
                const dgfem_real *a =
                    DGFEM_PATH(dgfemi_strip)(p, pivot_strips + strip) + (size_t)from * DGFEM_STRIP;
                int row = strip * DGFEM_STRIP, vectors = DGFEM_PATH(dgfemi_strip_vectors)(p->height, row);
                int end = row + DGFEM_STRIP < p->height ? row + DGFEM_STRIP : p->height;
                if (end > chunk + DGFEM_UPDATE_COLUMNS) end = chunk + DGFEM_UPDATE_COLUMNS;
                for (j = chunk; j < end; j += DGFEM_TILE)
                    DGFEM_PATH(dgfemi_store_tile)(
                        a, DGFEM_PATH(dgfemi_panel_row)(p, pivot_strips * DGFEM_STRIP + j, from), count,
                        u + DGFEM_PATH(dgfemi_triangle_strip)(strip) + (size_t)j * DGFEM_STRIP, from > 0,
                        j > row ? (j - row) / DGFEM_V_LANES : 0, vectors, end - j);
            }
    }
}

/* ---- assembly ---- */

/* Zeros strips of a panel. */
static void DGFEM_PATH(dgfemi_clear_panel)(const dgfemi_panel *p, int first, int last) {
    int strip;
    for (strip = first; strip < last; strip++)
        memset(DGFEM_PATH(dgfemi_strip)(p, strip), 0,
               (size_t)DGFEM_PATH(dgfemi_strip_end)(p, strip, p->width) * DGFEM_STRIP * sizeof(dgfem_real));
}

/* to += from: `columns` columns of `rows` rows of two strips. */
static void DGFEM_PATH(dgfemi_add_rows)(dgfem_real *to, const dgfem_real *from, int columns, int rows) {
    int vectors = rows / DGFEM_V_LANES, k, v, i;
    if (rows == DGFEM_STRIP) vectors *= columns, columns = vectors > 0;
    for (k = 0; k < columns; k++, to += DGFEM_STRIP, from += DGFEM_STRIP) {
        dgfem_real sum[4];
        for (v = 0; v < vectors; v++) {
            dgfem_real *at = to + v * DGFEM_V_LANES;
            DGFEM_V_STORE(at, DGFEM_V_ADD(DGFEM_V_LOAD(at), DGFEM_V_LOAD(from + v * DGFEM_V_LANES)));
        }
        if (rows == DGFEM_STRIP) continue;
        for (v *= DGFEM_V_LANES; v + 4 <= rows; v += 4) {
            for (i = 0; i < 4; i++) sum[i] = to[v + i] + from[v + i];
            for (i = 0; i < 4; i++) to[v + i] = sum[i];
        }
        for (; v < rows; v++) to[v] += from[v];
    }
}

/* Adds the rows of a child's update that the segments first <= i < last name: their columns that belong to the front's
   panel, or those that belong to its own update. */
static void DGFEM_PATH(dgfemi_add_update)(const dgfemi_extension *e, int first, int last) {
    int pivot_strips = DGFEM_PATH(dgfemi_strips)(e->panel.width), width = e->panel.width, s, k, i;
    for (s = first; s < last; s++) {
        const dgfemi_run *rows = e->segments + s;
        const dgfem_real *from = e->child + DGFEM_PATH(dgfemi_triangle_strip)(rows->row / DGFEM_STRIP);
        int row = rows->front_row, shift = e->update ? width : 0;
        dgfem_real *to;
        if (e->update) to = e->update + DGFEM_PATH(dgfemi_triangle_strip)((row - width) / DGFEM_STRIP);
        else if (row < width) to = DGFEM_PATH(dgfemi_strip)(&e->panel, row / DGFEM_STRIP);
        else to = DGFEM_PATH(dgfemi_strip)(&e->panel, pivot_strips + (row - width) / DGFEM_STRIP);
        to += (row < width ? row : row - width) % DGFEM_STRIP;
        from += rows->row % DGFEM_STRIP;
        for (k = 0; k < e->run_count && e->runs[k].row < rows->row + rows->length; k++) {
            const dgfemi_run *columns = e->runs + k;
            const dgfem_real *source = from + (size_t)columns->row * DGFEM_STRIP;
            dgfem_real *target = to + (size_t)(columns->front_row - shift) * DGFEM_STRIP;
            int whole = rows->row - columns->row, skip = 0; /* columns left of the diagonal; rows above it */
            if (whole > columns->length) whole = columns->length;
            if (whole > 0) DGFEM_PATH(dgfemi_add_rows)(target, source, whole, rows->length);
            else skip = -whole, whole = 0;
            for (; whole < columns->length && skip < rows->length; whole++, skip++)
                for (i = skip; i < rows->length; i++)
                    target[whole * DGFEM_STRIP + i] += source[whole * DGFEM_STRIP + i];
        }
    }
}

/* Adds one block of A to a panel; of diagonal blocks the lower half. */
static void DGFEM_PATH(dgfemi_add_block)(const dgfemi_panel *p, const dgfemi_entry *entry, const dgfem_real *block) {
    int pivot_strips = DGFEM_PATH(dgfemi_strips)(p->width), i, j, end;
    int rows = entry->transposed ? entry->columns : entry->rows, columns = entry->transposed ? entry->rows : entry->columns;
    int down = entry->transposed ? 1 : entry->columns, across = entry->transposed ? entry->columns : 1;
    for (i = 0; i < rows; i = end) { /* the rows that are in one strip */
        int row = entry->front_row + i, below = row >= p->width;
        int strip = below ? pivot_strips + (row - p->width) / DGFEM_STRIP : row / DGFEM_STRIP;
        int place = (below ? row - p->width : row) % DGFEM_STRIP, k;
        dgfem_real *to = DGFEM_PATH(dgfemi_strip)(p, strip) + (size_t)entry->front_column * DGFEM_STRIP + place - i;
        end = rows - i < DGFEM_STRIP - place ? rows : i + DGFEM_STRIP - place;
        for (j = 0; j < columns; j++, to += DGFEM_STRIP) {
            const dgfem_real *from = block + (ptrdiff_t)j * across;
            k = entry->front_row == entry->front_column && j > i ? j : i;
            if (down == 1)
                for (; k < end; k++) to[k] += from[k];
            else
                for (; k < end; k++) to[k] += from[(ptrdiff_t)k * down];
        }
    }
}

/* ---- solves ---- */

/* y[v] -= sum over k of strip(v, k) x[k] */
DGFEM_INLINE void DGFEM_PATH(dgfemi_strip_subtract)(const dgfem_real *strip, int columns, const dgfem_real *x,
                                                    dgfem_real *y) {
    DGFEM_VECTOR sum[DGFEM_VECTORS];
    int k, v;
    DGFEM_UNROLL
    for (v = 0; v < DGFEM_VECTORS; v++) sum[v] = DGFEM_V_LOAD(y + v * DGFEM_V_LANES);
    for (k = 0; k < columns; k++, strip += DGFEM_STRIP) {
        DGFEM_VECTOR factor = DGFEM_V_ALL(x[k]);
        DGFEM_UNROLL
        for (v = 0; v < DGFEM_VECTORS; v++) sum[v] = DGFEM_V_FNMA(DGFEM_V_LOAD(strip + v * DGFEM_V_LANES), factor, sum[v]);
    }
    DGFEM_UNROLL
    for (v = 0; v < DGFEM_VECTORS; v++) DGFEM_V_STORE(y + v * DGFEM_V_LANES, sum[v]);
}

/* x = L^-1 x for a supernode's own unknowns; below = -B x. Both have room for whole strips. */
static void DGFEM_PATH(dgfemi_solve_panel)(const dgfemi_panel *p, dgfem_real *x, dgfem_real *below) {
    int pivot_strips = DGFEM_PATH(dgfemi_strips)(p->width), strips = DGFEM_PATH(dgfemi_strips)(p->height), strip, c, v;
    for (strip = 0; strip < pivot_strips; strip++) {
        int first = strip * DGFEM_STRIP, columns = DGFEM_PATH(dgfemi_strip_end)(p, strip, p->width) - first;
        const dgfem_real *triangle = DGFEM_PATH(dgfemi_strip)(p, strip) + (size_t)first * DGFEM_STRIP;
        dgfem_real *y = x + first;
        DGFEM_PATH(dgfemi_strip_subtract)(DGFEM_PATH(dgfemi_strip)(p, strip), first, x, y);
        for (c = 0; c < columns; c++, triangle += DGFEM_STRIP) {
            dgfem_real value = y[c] * triangle[c];
            for (v = c / DGFEM_V_LANES; v < DGFEM_VECTORS; v++) {
                DGFEM_VECTOR column = DGFEM_V_LOAD(triangle + v * DGFEM_V_LANES);
                dgfem_real *at = y + v * DGFEM_V_LANES;
                DGFEM_V_STORE(at, DGFEM_V_FNMA(column, DGFEM_V_ALL(value), DGFEM_V_LOAD(at)));
            }
            y[c] = value;
        }
    }
    memset(below, 0, (size_t)strips * DGFEM_STRIP * sizeof *below);
    for (strip = 0; strip < strips; strip++, below += DGFEM_STRIP)
        DGFEM_PATH(dgfemi_strip_subtract)(DGFEM_PATH(dgfemi_strip)(p, pivot_strips + strip), p->width, x, below);
}

/* sums[k] += the vectors of column k of a strip times those of y, whose own sums are left to the end: so L is read in
   the order in which it lies in memory. */
static void DGFEM_PATH(dgfemi_strip_dot)(const dgfem_real *strip, int columns, const dgfem_real *y, dgfem_real *sums) {
    DGFEM_VECTOR factor[DGFEM_VECTORS];
    int k, v;
    DGFEM_UNROLL
    for (v = 0; v < DGFEM_VECTORS; v++) factor[v] = DGFEM_V_LOAD(y + v * DGFEM_V_LANES);
    for (k = 0; k < columns; k++, strip += DGFEM_STRIP, sums += DGFEM_V_LANES) {
        DGFEM_VECTOR sum = DGFEM_V_LOAD(sums);
        DGFEM_UNROLL
        for (v = 0; v < DGFEM_VECTORS; v++) sum = DGFEM_V_FMA(DGFEM_V_LOAD(strip + v * DGFEM_V_LANES), factor[v], sum);
        DGFEM_V_STORE(sums, sum);
    }
}

/* x = L^-T (x - B^T below); both end in zeros up to whole strips. sums has a vector for each column. */
static void DGFEM_PATH(dgfemi_solve_panel_transposed)(const dgfemi_panel *p, dgfem_real *x, const dgfem_real *below,
                                                      dgfem_real *sums) {
    int pivot_strips = DGFEM_PATH(dgfemi_strips)(p->width), strips = DGFEM_PATH(dgfemi_strips)(p->height);
    int strip, c, r, i;
    memset(sums, 0, (size_t)p->width * DGFEM_V_LANES * sizeof *sums);
    for (strip = 0; strip < strips; strip++)
        DGFEM_PATH(dgfemi_strip_dot)(DGFEM_PATH(dgfemi_strip)(p, pivot_strips + strip), p->width,
                                     below + strip * DGFEM_STRIP, sums);
    for (strip = pivot_strips - 1; strip >= 0; strip--) {
        int first = strip * DGFEM_STRIP, columns = DGFEM_PATH(dgfemi_strip_end)(p, strip, p->width) - first;
        const dgfem_real *triangle = DGFEM_PATH(dgfemi_strip)(p, strip) + (size_t)first * DGFEM_STRIP;
        dgfem_real *y = x + first;
        for (c = columns - 1; c >= 0; c--) {
            const dgfem_real *column = triangle + c * DGFEM_STRIP, *parts = sums + (first + c) * DGFEM_V_LANES;
            dgfem_real sum[4] = {0, 0, 0, 0};
            for (i = 0; i < DGFEM_V_LANES; i++) sum[i % 4] += parts[i];
            for (r = c + 1; r < columns; r++) sum[r % 4] += column[r] * y[r];
            y[c] = (y[c] - ((sum[0] + sum[1]) + (sum[2] + sum[3]))) * column[c];
        }
        DGFEM_PATH(dgfemi_strip_dot)(DGFEM_PATH(dgfemi_strip)(p, strip), first, y, sums);
    }
}

/* ---- products with row-major blocks ---- */

/* With `direct` y += A x, with `transposed` w += A^T z, for `vectors` vectors of columns: the block is read once. A^T z
   is summed up before it is added, so that it makes no difference to the bits whether it is added to w at once, or
   kept and added later. */
DGFEM_INLINE void DGFEM_PATH(dgfemi_multiply_columns)(const dgfem_real *a, int stride, int rows, int vectors,
                                                      int direct, int transposed, const dgfem_real *x, dgfem_real *y,
                                                      const dgfem_real *z, dgfem_real *w) {
    DGFEM_VECTOR in[DGFEM_VECTORS], out[DGFEM_VECTORS];
    int i, v, n, k;
    DGFEM_UNROLL
    for (v = 0; v < vectors; v++) {
        in[v] = direct ? DGFEM_V_LOAD(x + v * DGFEM_V_LANES) : DGFEM_V_ALL(0);
        out[v] = DGFEM_V_ALL(0);
    }
    for (i = 0; i < rows; i++, a += stride) {
        if (transposed) {
            DGFEM_VECTOR factor = DGFEM_V_ALL(z[i]);
            DGFEM_UNROLL
            for (v = 0; v < vectors; v++) out[v] = DGFEM_V_FMA(DGFEM_V_LOAD(a + v * DGFEM_V_LANES), factor, out[v]);
        }
        if (direct) {
            dgfem_real parts[DGFEM_V_LANES];
            DGFEM_VECTOR sum = DGFEM_V_MUL(DGFEM_V_LOAD(a), in[0]);
            DGFEM_UNROLL
            for (v = 1; v < vectors; v++) sum = DGFEM_V_FMA(DGFEM_V_LOAD(a + v * DGFEM_V_LANES), in[v], sum);
            DGFEM_V_STORE(parts, sum);
            DGFEM_UNROLL
            for (n = DGFEM_V_LANES / 2; n > 0; n /= 2)
                for (k = 0; k < n; k++) parts[k] += parts[k + n];
            y[i] += parts[0];
        }
    }
    DGFEM_UNROLL
    for (v = 0; v < vectors; v++) {
        dgfem_real *to = w + v * DGFEM_V_LANES;
        if (transposed) DGFEM_V_STORE(to, DGFEM_V_ADD(DGFEM_V_LOAD(to), out[v]));
    }
}

/* The same for all columns that vectors hold; returns the first column that is left. */
DGFEM_INLINE int DGFEM_PATH(dgfemi_multiply_all)(const dgfem_real *a, int rows, int columns, int direct, int transposed,
                                                 const dgfem_real *x, dgfem_real *y, const dgfem_real *z,
                                                 dgfem_real *w) {
    const int wide = DGFEM_STRIP;
    int j = 0;
    for (; j + wide <= columns; j += wide)
        DGFEM_PATH(dgfemi_multiply_columns)(a + j, columns, rows, DGFEM_VECTORS, direct, transposed,
                                            direct ? x + j : NULL, y, z, transposed ? w + j : NULL);
    for (; j + DGFEM_V_LANES <= columns; j += DGFEM_V_LANES)
        DGFEM_PATH(dgfemi_multiply_columns)(a + j, columns, rows, 1, direct, transposed, direct ? x + j : NULL, y, z,
                                            transposed ? w + j : NULL);
    return j;
}

/* y += A x, unless x is NULL, and w += A^T z, unless z is NULL. */
static void DGFEM_PATH(dgfemi_multiply_block)(const dgfem_real *a, int rows, int columns, const dgfem_real *x,
                                              dgfem_real *y, const dgfem_real *z, dgfem_real *w) {
    int j, i;
    if (x && z) j = DGFEM_PATH(dgfemi_multiply_all)(a, rows, columns, 1, 1, x, y, z, w);
    else if (x) j = DGFEM_PATH(dgfemi_multiply_all)(a, rows, columns, 1, 0, x, y, NULL, NULL);
    else j = DGFEM_PATH(dgfemi_multiply_all)(a, rows, columns, 0, 1, NULL, NULL, z, w);
    for (; j < columns; j++) {
        dgfem_real sum = 0;
        for (i = 0; i < rows; i++) {
            dgfem_real value = a[(size_t)i * (size_t)columns + (size_t)j];
            if (x) y[i] += value * x[j];
            if (z) sum += value * z[i];
        }
        if (z) w[j] += sum;
    }
}

/* ---- 3x3 matrices ---- */

#if DGFEM_V_LANES <= 4
/* row += from: whole vectors, and then single numbers first <= k < last. */
DGFEM_INLINE void DGFEM_PATH(dgfemi_add_row)(const dgfem_real *from, int vectors, int first, int last,
                                             dgfem_real *row) {
    int k, v;
    for (v = 0; v < vectors; v++)
        DGFEM_V_STORE(row + v * DGFEM_V_LANES,
                      DGFEM_V_ADD(DGFEM_V_LOAD(row + v * DGFEM_V_LANES), DGFEM_V_LOAD(from + v * DGFEM_V_LANES)));
    for (k = first; k < last; k++) row[k] += from[k];
}

/* Three rows of which `count` numbers count; behind them come zeros, and `room` numbers are left in the block's rows.
   */
static void DGFEM_PATH(dgfemi_add_rows_of)(const dgfem_real *from, int from_stride, int count, int room,
                                           dgfem_real *row, int stride) {
    int vectors = (count + DGFEM_V_LANES - 1) / DGFEM_V_LANES, most = room / DGFEM_V_LANES, p;
    if (vectors > most) vectors = most;
    for (p = 0; p < 3; p++, from += from_stride, row += stride)
        DGFEM_PATH(dgfemi_add_row)(from, vectors, vectors * DGFEM_V_LANES, count, row);
}

/* k = lambda u v^T + mu v u^T + mu (u.v) I */
static void DGFEM_PATH(dgfemi_set_elastic)(dgfem_real lambda, dgfem_real mu, const dgfem_real *u, const dgfem_real *v,
                                           dgfem_real *k) {
    static const dgfem_real unit[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
    const DGFEM_VECTOR d = DGFEM_V_ALL(mu * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]));
    int p, c;
    DGFEM_UNROLL
    for (p = 0; p < 3; p++) {
        DGFEM_UNROLL
        for (c = 0; c < 4; c += DGFEM_V_LANES) {
            DGFEM_VECTOR row = DGFEM_V_MUL(DGFEM_V_LOAD(unit[p] + c), d);
            row = DGFEM_V_FMA(DGFEM_V_LOAD(u + c), DGFEM_V_ALL(mu * v[p]), row);
            DGFEM_V_STORE(k + 4 * p + c, DGFEM_V_FMA(DGFEM_V_LOAD(v + c), DGFEM_V_ALL(lambda * u[p]), row));
        }
    }
}

/* out[i] = k[i]^T v for `count` matrices */
static void DGFEM_PATH(dgfemi_transform)(const dgfem_real *k, int count, const dgfem_real *v, dgfem_real *out) {
    const DGFEM_VECTOR x = DGFEM_V_ALL(v[0]), y = DGFEM_V_ALL(v[1]), z = DGFEM_V_ALL(v[2]);
    int i, c;
    for (i = 0; i < count; i++, k += DGFEM_MATRIX_STRIDE, out += DGFEM_VECTOR_STRIDE)
        for (c = 0; c < 4; c += DGFEM_V_LANES) {
            DGFEM_VECTOR sum = DGFEM_V_MUL(DGFEM_V_LOAD(k + c), x);
            sum = DGFEM_V_FMA(DGFEM_V_LOAD(k + 4 + c), y, sum);
            DGFEM_V_STORE(out + c, DGFEM_V_FMA(DGFEM_V_LOAD(k + 8 + c), z, sum));
        }
}

/* out += a sum of three vectors of b for each part, with the part's three factors. */
static void DGFEM_PATH(dgfemi_add_vectors)(const dgfem_real **parts, int count, const dgfem_real *b, dgfem_real *out) {
    enum { VECTORS = 4 / DGFEM_V_LANES };
    dgfem_real vector[4];
    DGFEM_VECTOR sum[3 * VECTORS];
    int k, d, v;
    DGFEM_UNROLL
    for (v = 0; v < 3 * VECTORS; v++) sum[v] = DGFEM_V_ALL(0);
    for (k = 0; k < count; k++, b += 3 * DGFEM_VECTOR_STRIDE) {
        DGFEM_UNROLL
        for (d = 0; d < 3; d++) {
            DGFEM_VECTOR factor = DGFEM_V_ALL(parts[k][d]);
            DGFEM_UNROLL
            for (v = 0; v < VECTORS; v++)
                sum[d * VECTORS + v] = DGFEM_V_FMA(DGFEM_V_LOAD(b + d * DGFEM_VECTOR_STRIDE + v * DGFEM_V_LANES),
                                                   factor, sum[d * VECTORS + v]);
        }
    }
    DGFEM_UNROLL
    for (v = 0; v < VECTORS; v++)
        DGFEM_V_STORE(vector + v * DGFEM_V_LANES,
                      DGFEM_V_ADD(DGFEM_V_ADD(sum[v], sum[VECTORS + v]), sum[2 * VECTORS + v]));
    for (d = 0; d < 3; d++) out[d] += vector[d];
}
#endif

/* What row i of the sums adds to three rows of the block. */
DGFEM_INLINE void DGFEM_PATH(dgfemi_make_rows)(const dgfem_real *a, int count, int inner, const DGFEM_VECTOR *b,
                                               dgfem_real (*rows)[3 * DGFEM_MATRICES_IN_A_ROW + 4]) {
    enum { VECTORS = (12 + DGFEM_V_LANES - 1) / DGFEM_V_LANES };
    int j, k, v, p;
    for (j = 0; j < count; j++, a += inner) {
        dgfem_real matrix[VECTORS * DGFEM_V_LANES];
        DGFEM_VECTOR sum[VECTORS];
        DGFEM_UNROLL
        for (v = 0; v < VECTORS; v++) sum[v] = DGFEM_V_MUL(b[v], DGFEM_V_ALL(a[0]));
        DGFEM_UNROLL
        for (k = 1; k < inner; k++) {
            DGFEM_VECTOR factor = DGFEM_V_ALL(a[k]);
            DGFEM_UNROLL
            for (v = 0; v < VECTORS; v++) sum[v] = DGFEM_V_FMA(b[k * VECTORS + v], factor, sum[v]);
        }
        DGFEM_UNROLL
        for (v = 0; v < VECTORS; v++) DGFEM_V_STORE(matrix + v * DGFEM_V_LANES, sum[v]);
        DGFEM_UNROLL
        for (p = 0; p < 3; p++) /* the fourth number is overwritten by the next matrix */
            memcpy(rows[p] + 3 * j, matrix + 4 * p, 4 * sizeof *matrix);
    }
    for (p = 0; p < 3; p++)
        for (k = 0; k < 4; k++) rows[p][3 * count + k] = 0;
}

/* Several rows are made before they are added: what was stored in other pieces is slow to read back at once. */
DGFEM_INLINE void DGFEM_PATH(dgfemi_add_sums)(const dgfemi_sums *sums, int inner) {
    enum { VECTORS = (12 + DGFEM_V_LANES - 1) / DGFEM_V_LANES, TOGETHER = 4 };
    DGFEM_VECTOR b[9 * VECTORS];
    dgfem_real rows[3 * TOGETHER][3 * DGFEM_MATRICES_IN_A_ROW + 4];
    const dgfem_real *a = sums->a;
    int first, last, i, k, v;
    DGFEM_UNROLL
    for (k = 0; k < inner; k++) {
        const dgfem_real *from = k < 2 ? sums->b[0] : k < 5 ? sums->b[1] : sums->b[2];
        DGFEM_UNROLL
        for (v = 0; v < VECTORS; v++)
            b[k * VECTORS + v] = DGFEM_V_LOAD(from + (k < 2 ? k : k < 5 ? k - 2 : k - 5) * DGFEM_MATRIX_STRIDE +
                                              v * DGFEM_V_LANES);
    }
    for (first = 0; first < sums->rows; first = last) {
        last = first + TOGETHER < sums->rows ? first + TOGETHER : sums->rows;
        for (i = first; i < last; i++) {
            DGFEM_PATH(dgfemi_make_rows)(a, sums->count ? sums->count : i + 1, inner, b, rows + 3 * (i - first));
            a += sums->step + (i + 1) * sums->growth;
        }
        for (i = first; i < last; i++)
            DGFEM_FOUR(dgfemi_add_rows_of)(rows[3 * (i - first)], 3 * DGFEM_MATRICES_IN_A_ROW + 4,
                                           3 * (sums->count ? sums->count : i + 1), sums->room,
                                           sums->out + 3 * i * sums->stride, sums->stride);
    }
}

static void DGFEM_PATH(dgfemi_add_matrices)(const dgfemi_sums *sums) {
    if (sums->inner == 2) DGFEM_PATH(dgfemi_add_sums)(sums, 2);
    else if (sums->inner == 8) DGFEM_PATH(dgfemi_add_sums)(sums, 8);
    else DGFEM_PATH(dgfemi_add_sums)(sums, 9);
}

static const dgfemi_kernels *DGFEM_PATH(dgfemi_kernels)(void) {
    static const dgfemi_kernels kernels = {
        DGFEM_PATH_ID,
        DGFEM_STRIP,
        DGFEM_TILE,
        DGFEM_V_LANES,
        DGFEM_PATH(dgfemi_factor_strips),
        DGFEM_PATH(dgfemi_update_strips),
        DGFEM_PATH(dgfemi_make_update),
        DGFEM_PATH(dgfemi_clear_panel),
        DGFEM_PATH(dgfemi_add_update),
        DGFEM_PATH(dgfemi_add_block),
        DGFEM_PATH(dgfemi_solve_panel),
        DGFEM_PATH(dgfemi_solve_panel_transposed),
        DGFEM_PATH(dgfemi_multiply_block),
        DGFEM_PATH(dgfemi_add_matrices),
        DGFEM_FOUR(dgfemi_set_elastic),
        DGFEM_FOUR(dgfemi_transform),
        DGFEM_FOUR(dgfemi_add_vectors),
    };
    return &kernels;
}

#undef DGFEM_STRIP
#undef DGFEM_CASE_3
#undef DGFEM_CASE_4
#undef DGFEM_SWITCH
#undef DGFEM_PATH
#undef DGFEM_FOUR
#undef DGFEM_PATH_ID
#undef DGFEM_VECTOR
#undef DGFEM_V_LANES
#undef DGFEM_VECTORS
#undef DGFEM_TILE
#undef DGFEM_V_LOAD
#undef DGFEM_V_STORE
#undef DGFEM_V_ALL
#undef DGFEM_V_ADD
#undef DGFEM_V_SUB
#undef DGFEM_V_MUL
#undef DGFEM_V_FMA
#undef DGFEM_V_FNMA
