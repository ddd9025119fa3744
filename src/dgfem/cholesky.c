#pragma once
#include "symbolic.c"
/* Sparse Cholesky factorization A = L L^T of matrices in blocks: multifrontal factorization, solves. */

DGFEM_API dgfem_cholesky_desc dgfem_default_cholesky_desc(void) {
    dgfem_cholesky_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.ordering = DGFEM_ORDERING_AUTO;
    desc.simd = DGFEM_SIMD_AUTO;
    return desc;
}

DGFEM_API dgfem_status dgfem_cholesky_create(const dgfem_matrix *matrix, const dgfem_cholesky_desc *desc,
                                             dgfem_cholesky **out) {
    const dgfemi_kernels *kernels;
    dgfemi_arena arena;
    dgfem_cholesky *c;
    dgfem_status status;
    int analysed = 0;
    if (out) *out = NULL;
    status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    if (!matrix || !out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: matrix or out is NULL");
    if ((int)desc->ordering < 0 || desc->ordering > DGFEM_ORDERING_QUICK)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: unknown ordering %d", (int)desc->ordering);
    if (desc->ordering == DGFEM_ORDERING_NESTED_DISSECTION && !matrix->centres)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: nested dissection needs the blocks' centres");
    kernels = dgfemi_kernels_choose(desc->simd);
    if (!kernels)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: instruction set %d is not to be had here",
                           (int)desc->simd);
    c = (dgfem_cholesky *)dgfemi_allocate_zero(&desc->hooks, 1, sizeof *c);
    if (c) {
        c->hooks = desc->hooks;
        c->kernels = kernels;
        c->block_count = matrix->block_count;
        c->size = matrix->size;
        c->pattern = dgfemi_pattern_hash(matrix);
        arena = dgfemi_arena_make(&desc->hooks);
        analysed = dgfemi_analyse(c, matrix, desc->ordering, &arena);
        dgfemi_arena_free(&arena);
    }
    if (!analysed) {
        dgfem_cholesky_destroy(c);
        return dgfemi_fail_memory(&desc->hooks);
    }
    *out = c;
    return DGFEM_OK;
}

DGFEM_API void dgfem_cholesky_destroy(dgfem_cholesky *c) {
    dgfem_hooks hooks;
    if (!c) return;
    hooks = c->hooks;
    dgfemi_free(&hooks, c->order);
    dgfemi_free(&hooks, c->offset);
    dgfemi_free(&hooks, c->source);
    dgfemi_free(&hooks, c->supernodes);
    dgfemi_free(&hooks, c->rows);
    dgfemi_free(&hooks, c->runs);
    dgfemi_free(&hooks, c->segments);
    dgfemi_free(&hooks, c->entries);
    dgfemi_free(&hooks, c->tasks);
    dgfemi_free(&hooks, c->memory);
    dgfemi_free(&hooks, c);
}

/* ---- numeric factorization ---- */

static dgfemi_panel dgfemi_panel_of(const dgfem_cholesky *c, const dgfemi_supernode *super) {
    dgfemi_panel panel;
    panel.values = c->values + super->values;
    panel.width = super->width;
    panel.height = super->height;
    return panel;
}

/* Work on one front that several threads may share: strips first <= i < last in groups. */
typedef struct dgfemi_front {
    dgfem_cholesky *c;
    const dgfemi_supernode *super;
    dgfemi_panel panel;
    dgfem_real *update;
    const dgfem_real *diagonal;
    int pivot_strips, strips; /* of D; of B */
    int packed;               /* 1: c->packed holds B, for BLAS */
    int first, last, from, to;
    int group;  /* strips that are worked on together, so that they stay in cache from one phase to the next */
    int shared; /* 0: one thread does it all */
    void (*work)(const struct dgfemi_front *front, int first, int last);
} dgfemi_front;

#define DGFEM_GROUP_ROWS 48     /* of a group of strips */
#define DGFEM_SMALL_FRONT 32768. /* reals; a smaller front is in cache as a whole */

/* Groups from both ends by turns: later strips have more to do than earlier ones, so equal numbers of groups are about
   equal work. */
static void dgfemi_front_range(void *context, int first, int last) {
    const dgfemi_front *f = (const dgfemi_front *)context;
    int groups = (f->last - f->first + f->group - 1) / f->group, i;
    for (i = first; i < last; i++) {
        int group = i % 2 ? groups - 1 - i / 2 : i / 2;
        int from = f->first + group * f->group, to = from + f->group;
        f->work(f, from, to < f->last ? to : f->last);
    }
}

/* Does `work` for all strips first <= i < last. What is done for one does not depend on the others. */
static void dgfemi_share(dgfemi_front *f, int first, int last,
                         void (*work)(const dgfemi_front *front, int first, int last)) {
    f->first = first, f->last = last, f->work = work;
    if (f->shared && first < last) {
        dgfemi_parallel_for(&f->c->hooks, (last - first + f->group - 1) / f->group, 1, dgfemi_front_range, f);
        return;
    }
    for (; first < last; first += f->group) work(f, first, last - first < f->group ? last : first + f->group);
}

/* The first segment of a child, from `low` to `high`, whose row in the front is `row` or a later one. */
static int dgfemi_find_segment(const dgfem_cholesky *c, int low, int high, int row) {
    while (low < high) {
        int middle = low + (high - low) / 2;
        if (c->segments[middle].front_row < row) low = middle + 1;
        else high = middle;
    }
    return low;
}

/* Adds the rows first <= i < last of the children's updates: the columns that belong to the panel, or those that belong
   to the front's own update. */
static void dgfemi_add_children(const dgfemi_front *f, int first, int last, int in_panel) {
    const dgfem_cholesky *c = f->c;
    dgfemi_extension extension;
    int k;
    extension.panel = f->panel;
    extension.update = in_panel ? NULL : f->update;
    extension.segments = c->segments;
    for (k = f->super->child; k != DGFEM_NONE; k = c->supernodes[k].sibling) {
        const dgfemi_supernode *child = c->supernodes + k;
        int first_run = in_panel ? child->run_start : child->run_middle;
        int start = dgfemi_find_segment(c, child->segment_start, child->segment_end, first);
        int end = dgfemi_find_segment(c, start, child->segment_end, last);
        extension.child = c->values + child->update;
        extension.runs = c->runs + first_run;
        extension.run_count = (in_panel ? child->run_middle : child->run_end) - first_run;
        if (start < end) c->kernels->add_update(&extension, start, end);
    }
}

/* The rows of the front that strips of the panel hold: of D, or of B. */
static void dgfemi_gather_panel(const dgfemi_front *f, int first, int last) {
    int strip = f->c->kernels->strip, width = f->panel.width, pivots = f->pivot_strips;
    f->c->kernels->clear_panel(&f->panel, first, last);
    if (first < pivots)
        dgfemi_add_children(f, first * strip, last < pivots ? last * strip : width, 1);
    if (last > pivots)
        dgfemi_add_children(f, width + (first > pivots ? first - pivots : 0) * strip, width + (last - pivots) * strip, 1);
}

/* Gathers D and B of a front: from the children and from A, whose diagonal is kept. */
static void dgfemi_assemble(dgfemi_front *f, const dgfem_matrix *matrix) {
    const dgfem_cholesky *c = f->c;
    int k, i;
    dgfemi_share(f, 0, f->pivot_strips + f->strips, dgfemi_gather_panel);
    for (k = f->super->entry_start; k < f->super->entry_end; k++) {
        const dgfemi_entry *entry = c->entries + k;
        const dgfem_real *block = matrix->values + matrix->value_start[entry->block];
        c->kernels->add_block(&f->panel, entry, block);
        if (entry->front_row != entry->front_column) continue;
        for (i = 0; i < entry->rows; i++)
            c->diagonal[f->super->column + entry->front_row + i] = block[(size_t)i * (size_t)(entry->rows + 1)];
    }
}

static void dgfemi_factor_rows(const dgfemi_front *f, int first, int last) {
    (void)f->c->kernels->factor_strips(&f->panel, first, last, f->from, f->to, f->diagonal);
}

static void dgfemi_update_rows(const dgfemi_front *f, int first, int last) {
    f->c->kernels->update_strips(&f->panel, first, last, f->from, f->to);
}

/* D = L L^T, B = B L^-T. Returns the column whose pivot fails, or DGFEM_NONE. */
static int dgfemi_factor_panel(dgfemi_front *f) {
    const dgfemi_kernels *kernels = f->c->kernels;
    int width = f->panel.width, strip = kernels->strip, strips = f->pivot_strips + f->strips;
    for (f->from = 0; f->from < width; f->from = f->to) {
        int first = f->from / strip, last, failed;
        f->to = width - f->from < DGFEM_PANEL_COLUMNS ? width : f->from + DGFEM_PANEL_COLUMNS;
        last = dgfemi_whole_strips(f->to, strip);
        failed = kernels->factor_strips(&f->panel, first, last, f->from, f->to, f->diagonal);
        if (failed != DGFEM_NONE) return failed;
        dgfemi_share(f, last, strips, dgfemi_factor_rows);
        if (f->to < width) dgfemi_share(f, last, strips, dgfemi_update_rows);
    }
    return DGFEM_NONE;
}

#ifdef DGFEM_USE_BLAS
static const dgfem_real *dgfemi_strip_of_b(const dgfemi_front *f, int strip) {
    size_t rows = (size_t)f->c->kernels->strip, width = (size_t)f->panel.width;
    return f->panel.values + dgfemi_triangle_size(f->panel.width, f->c->kernels->strip) + (size_t)strip * rows * width;
}

/* B in columns, as BLAS wants one operand of B B^T; strips will do for the other, and for the result. */
static void dgfemi_pack_for_blas(dgfemi_front *f) {
    int strip = f->c->kernels->strip, width = f->panel.width, height = f->panel.height, s, k;
    for (s = 0; s < f->strips; s++) {
        const dgfem_real *from = dgfemi_strip_of_b(f, s);
        int rows = height - s * strip < strip ? height - s * strip : strip;
        for (k = 0; k < width; k++, from += strip)
            memcpy(f->c->packed + (size_t)k * (size_t)height + (size_t)s * (size_t)strip, from,
                   (size_t)rows * sizeof *from);
    }
    f->packed = 1;
}

static void dgfemi_make_update_by_blas(const dgfemi_front *f, int first, int last) {
    int strip = f->c->kernels->strip, width = f->panel.width, height = f->panel.height, s;
    for (s = first; s < last; s++) {
        const dgfem_real *a = dgfemi_strip_of_b(f, s);
        dgfem_real *u = f->update + (size_t)s * ((size_t)s + 1) / 2 * (size_t)strip * (size_t)strip;
        int columns = (s + 1) * strip < height ? (s + 1) * strip : height;
#if DGFEM_REAL_IS_FLOAT
        cblas_sgemm(CblasColMajor, CblasNoTrans, CblasTrans, strip, columns, width, -1, a, strip, f->c->packed, height,
                    0, u, strip);
#else
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, strip, columns, width, -1, a, strip, f->c->packed, height,
                    0, u, strip);
#endif
    }
}
#endif

/* U = -B B^T and what the children pass on. */
static void dgfemi_make_rows_of_update(const dgfemi_front *f, int first, int last) {
    int strip = f->c->kernels->strip, width = f->panel.width;
#ifdef DGFEM_USE_BLAS
    if (f->packed) dgfemi_make_update_by_blas(f, first, last);
#endif
    if (!f->packed) f->c->kernels->make_update(&f->panel, f->update, first, last);
    dgfemi_add_children(f, width + first * strip, width + last * strip, 0);
}

/* Children come before parents; no front looks at any other than its children. Returns the position whose pivot fails,
   or DGFEM_NONE. */
static int dgfemi_factor_front(dgfem_cholesky *c, int s, const dgfem_matrix *matrix, int may_share) {
    const dgfemi_supernode *super = c->supernodes + s;
    int strip = c->kernels->strip, failed, t;
    dgfemi_front front;
    memset(&front, 0, sizeof front);
    front.c = c;
    front.super = super;
    front.panel = dgfemi_panel_of(c, super);
    front.update = c->values + super->update;
    front.diagonal = c->diagonal + super->column;
    front.pivot_strips = dgfemi_whole_strips(super->width, strip);
    front.strips = dgfemi_whole_strips(super->height, strip);
    front.shared = may_share && dgfemi_front_flops(super) > DGFEM_FRONT_FLOPS;
    front.group = strip < DGFEM_GROUP_ROWS ? DGFEM_GROUP_ROWS / strip : 1;
    if ((double)(super->width + super->height) * (super->width + super->height) < DGFEM_SMALL_FRONT)
        front.group = front.pivot_strips + front.strips;
    dgfemi_assemble(&front, matrix);
    failed = dgfemi_factor_panel(&front);
    if (failed != DGFEM_NONE) {
        for (t = super->first; c->offset[t + 1] <= super->column + failed;) t++;
        return t;
    }
#ifdef DGFEM_USE_BLAS
    /* there is room for one, and tasks run side by side */
    if (dgfemi_is_for_blas(super) && (may_share || c->task_count == 1)) dgfemi_pack_for_blas(&front);
#endif
    dgfemi_share(&front, 0, front.strips, dgfemi_make_rows_of_update);
    return DGFEM_NONE;
}

typedef struct dgfemi_factoring {
    dgfem_cholesky *c;
    const dgfem_matrix *matrix;
} dgfemi_factoring;

static void dgfemi_factor_tasks(void *context, int first, int last) {
    const dgfemi_factoring *f = (const dgfemi_factoring *)context;
    int k, s;
    for (k = first; k < last; k++) {
        dgfemi_task *task = f->c->tasks + k;
        task->failed = DGFEM_NONE;
        for (s = task->first; s < task->last && task->failed == DGFEM_NONE; s++)
            task->failed = dgfemi_factor_front(f->c, s, f->matrix, 0);
    }
}

/* All tasks, then what is above them: the same for any number of threads. Returns the first position whose pivot
   fails, or DGFEM_NONE. */
static int dgfemi_factor(dgfem_cholesky *c, const dgfem_matrix *matrix) {
    dgfemi_factoring factoring;
    int failed = DGFEM_NONE, k, s;
    factoring.c = c;
    factoring.matrix = matrix;
    dgfemi_parallel_for(&c->hooks, c->task_count, 1, dgfemi_factor_tasks, &factoring);
    for (k = 0; k < c->task_count; k++)
        if (c->tasks[k].failed != DGFEM_NONE && (failed == DGFEM_NONE || c->tasks[k].failed < failed))
            failed = c->tasks[k].failed;
    for (s = 0; s < c->supernode_count && failed == DGFEM_NONE; s++)
        if (c->supernodes[s].task == DGFEM_NONE) failed = dgfemi_factor_front(c, s, matrix, 1);
    return failed;
}

DGFEM_API dgfem_status dgfem_cholesky_factor(dgfem_cholesky *c, const dgfem_matrix *matrix, dgfem_cholesky_info *info) {
    int failed;
    if (info) {
        memset(info, 0, sizeof *info);
        info->failed_block = DGFEM_NONE;
    }
    if (!c) return DGFEM_ERROR_ARGUMENT;
    if (!matrix) return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: matrix is NULL");
    if (info) {
        info->factor_entries = c->factor_entries;
        info->factor_flops = c->factor_flops;
        info->supernodes = c->supernode_count;
        info->simd = c->kernels->simd;
    }
    if (matrix->block_count != c->block_count || matrix->size != c->size || dgfemi_pattern_hash(matrix) != c->pattern)
        return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: the matrix has not the pattern analysed");
    failed = dgfemi_factor(c, matrix);
    c->factored = failed == DGFEM_NONE;
    if (c->factored) return DGFEM_OK;
    if (info) info->failed_block = c->order[failed];
    return dgfemi_fail(&c->hooks, DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "cholesky: pivot of block %d", c->order[failed]);
}

/* ---- solves ---- */

/* Copies the unknowns of one supernode into c->own, with zeros up to whole strips; or back. */
static void dgfemi_gather_own(const dgfem_cholesky *c, const dgfemi_supernode *super, const dgfem_real *x) {
    int padded = dgfemi_whole_strips(super->width, c->kernels->strip) * c->kernels->strip;
    memcpy(c->own, x + super->column, (size_t)super->width * sizeof *x);
    memset(c->own + super->width, 0, (size_t)(padded - super->width) * sizeof *x);
}

/* The part of x at the rows below a supernode, or what changes it. */
static void dgfemi_add_below(const dgfem_cholesky *c, const dgfemi_supernode *super, dgfem_real *x) {
    const dgfem_real *below = c->below;
    int k, i;
    for (k = super->row_start; k < super->row_end; k++) {
        int count = c->offset[c->rows[k] + 1] - c->offset[c->rows[k]];
        dgfem_real *to = x + c->offset[c->rows[k]];
        for (i = 0; i < count; i++) to[i] += below[i];
        below += count;
    }
}

static void dgfemi_gather_below(const dgfem_cholesky *c, const dgfemi_supernode *super, const dgfem_real *x) {
    dgfem_real *below = c->below;
    int padded = dgfemi_whole_strips(super->height, c->kernels->strip) * c->kernels->strip, k, i;
    for (k = super->row_start; k < super->row_end; k++) {
        int count = c->offset[c->rows[k] + 1] - c->offset[c->rows[k]];
        const dgfem_real *from = x + c->offset[c->rows[k]];
        for (i = 0; i < count; i++) below[i] = from[i];
        below += count;
    }
    memset(below, 0, (size_t)(padded - super->height) * sizeof *below);
}

/* For up to DGFEM_SOLVES right-hand sides at a time: each panel is read once for all of them. */
static void dgfemi_solve(const dgfem_cholesky *c, int count, const dgfem_real *b, dgfem_real *x) {
    size_t size = (size_t)c->size;
    int s, k, r;
    for (r = 0; r < count; r++)
        for (k = 0; k < c->block_count; k++)
            memcpy(c->x + (size_t)r * size + c->offset[k], b + (size_t)r * size + c->source[k],
                   (size_t)(c->offset[k + 1] - c->offset[k]) * sizeof *x);
    for (s = 0; s < c->supernode_count; s++) {
        const dgfemi_supernode *super = c->supernodes + s;
        dgfemi_panel panel = dgfemi_panel_of(c, super);
        for (r = 0; r < count; r++) {
            dgfemi_gather_own(c, super, c->x + (size_t)r * size);
            c->kernels->solve_panel(&panel, c->own, c->below);
            memcpy(c->x + (size_t)r * size + super->column, c->own, (size_t)super->width * sizeof *x);
            dgfemi_add_below(c, super, c->x + (size_t)r * size);
        }
    }
    for (s = c->supernode_count - 1; s >= 0; s--) {
        const dgfemi_supernode *super = c->supernodes + s;
        dgfemi_panel panel = dgfemi_panel_of(c, super);
        for (r = 0; r < count; r++) {
            dgfemi_gather_own(c, super, c->x + (size_t)r * size);
            dgfemi_gather_below(c, super, c->x + (size_t)r * size);
            c->kernels->solve_panel_transposed(&panel, c->own, c->below, c->sums);
            memcpy(c->x + (size_t)r * size + super->column, c->own, (size_t)super->width * sizeof *x);
        }
    }
    for (r = 0; r < count; r++)
        for (k = 0; k < c->block_count; k++)
            memcpy(x + (size_t)r * size + c->source[k], c->x + (size_t)r * size + c->offset[k],
                   (size_t)(c->offset[k + 1] - c->offset[k]) * sizeof *x);
}

DGFEM_API dgfem_status dgfem_cholesky_solve_many(const dgfem_cholesky *c, int count, const dgfem_real *b,
                                                 dgfem_real *x) {
    int bad, r;
    if (!c) return DGFEM_ERROR_ARGUMENT;
    if (!b || !x) return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: b or x is NULL");
    if (count < 0) return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: %d right-hand sides", count);
    if (!c->factored) return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: no factorization to solve with");
    for (r = 0; r < count; r++) {
        bad = dgfemi_vector_not_finite(c->size, b + (size_t)r * (size_t)c->size);
        if (bad != DGFEM_NONE)
            return count == 1
                       ? dgfemi_fail(&c->hooks, DGFEM_ERROR_NOT_FINITE, "cholesky: b[%d]", bad)
                       : dgfemi_fail(&c->hooks, DGFEM_ERROR_NOT_FINITE, "cholesky: b[%d] of right-hand side %d", bad, r);
    }
    for (r = 0; r < count; r += DGFEM_SOLVES)
        dgfemi_solve(c, count - r < DGFEM_SOLVES ? count - r : DGFEM_SOLVES, b + (size_t)r * (size_t)c->size,
                     x + (size_t)r * (size_t)c->size);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_cholesky_solve(const dgfem_cholesky *c, const dgfem_real *b, dgfem_real *x) {
    return dgfem_cholesky_solve_many(c, 1, b, x);
}
