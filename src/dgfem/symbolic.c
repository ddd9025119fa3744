#pragma once
#include "ordering.c"
#include "panel.c"
/* Symbolic analysis of the sparse Cholesky factorization A = L L^T of matrices in blocks.

   A supernode is a range of columns of L with (nearly) the same rows below; its parent holds the first of these rows.
   Its front gathers all that eliminating its columns needs and gives:

            width  height
          +-------+         panel: becomes width + height rows of L
          |   D   |         D holds the pivots, B is the part below
          +-------+------+
          |   B   |  U   |  U: -B B^T plus the updates of the children; added into the parent's front,
          +-------+------+     whose rows contain those of U

   Positions are blocks in the order of elimination. */

typedef struct dgfemi_supernode {
    int first, last;            /* positions first <= k < last */
    int column;                 /* its first unknown, in the order of elimination */
    int width, height;          /* unknowns */
    int parent, child, sibling; /* supernodes: parent, first child, next child of the parent; or DGFEM_NONE */
    int row_start, row_end;     /* the rows below, in dgfem_cholesky.rows */
    int run_start, run_end;     /* where they go in the parent's front, in dgfem_cholesky.runs; */
    int run_middle;             /* the runs before it go to the parent's panel, those from it on to its update */
    int segment_start, segment_end; /* the same cut at the ends of strips, in dgfem_cholesky.segments */
    int segment_middle;
    int entry_start, entry_end; /* the blocks of A that its columns begin with, in dgfem_cholesky.entries */
    int task;                   /* that factors it; DGFEM_NONE: after all tasks, in ascending order */
    double flops;               /* of it and of its descendants */
    size_t values;              /* its panel, in dgfem_cholesky.values */
    size_t update;              /* its U, there too */
} dgfemi_supernode;

/* Supernodes first <= s < last that one worker factors: whole subtrees, which no other task looks at. */
typedef struct dgfemi_task {
    int first, last;
    int failed; /* the position whose pivot failed, or DGFEM_NONE */
    double flops;
} dgfemi_task;

struct dgfem_cholesky {
    dgfem_hooks hooks;
    const dgfemi_kernels *kernels;
    int block_count, size;
    uint64_t pattern; /* hash of the pattern analysed */
    int factored;     /* 1: values hold a factorization */
    int *order;       /* [block_count] the block at each position */
    int *offset;      /* [block_count + 1] first unknown of each position, in the order of elimination */
    int *source;      /* [block_count] first unknown of each position, in the order of the matrix */
    int supernode_count;
    dgfemi_supernode *supernodes; /* children before parents */
    int *rows;                    /* positions */
    dgfemi_run *runs, *segments;
    dgfemi_entry *entries;
    int task_count;
    dgfemi_task *tasks;   /* the largest first */
    void *memory;         /* of the following, which begin at cache lines */
    dgfem_real *values;   /* L, and the U that still wait for their parents */
    dgfem_real *own;      /* [largest width, in whole strips] a solve's unknowns of one supernode */
    dgfem_real *below;    /* [largest height, in whole strips] and those below it */
    dgfem_real *sums;     /* [largest width, in vectors] of a solve, one for each column */
    dgfem_real *x;        /* [DGFEM_SOLVES * size] a solve's vectors in the order of elimination */
    dgfem_real *diagonal; /* [size] of A, in the order of elimination */
    dgfem_real *packed;   /* with DGFEM_USE_BLAS: a large panel's B in columns */
    double factor_entries, factor_flops;
};

enum { DGFEM_SOLVES = 4 }; /* right-hand sides that are solved for together */

/* ---- the elimination tree and its supernodes ---- */

/* A fundamental supernode (columns with the same rows below) before merging; the others follow it in a chain. */
typedef struct dgfemi_node {
    int first, end;            /* positions first <= k < end */
    int width, height, blocks; /* unknowns; unknowns and blocks below */
    double zeros;              /* numbers in its columns that are zero in L */
    int child, sibling;        /* first child, next child of the parent; or DGFEM_NONE */
    int segment, last_segment; /* chain of the nodes that it consists of, in the order of their columns */
    int next_segment;
} dgfemi_node;

enum { DGFEM_MERGED = -2 }; /* the parent of a node that has been merged into its parent */

/* Scratch of the analysis. */
typedef struct dgfemi_analysis {
    dgfemi_graph graph;
    int *order, *position;     /* [block_count] inverse of each other */
    int *parent;               /* [block_count] elimination tree, of positions; later of nodes */
    int *below, *below_blocks; /* [block_count] unknowns and blocks below each block column of L */
    int *node_of;              /* [block_count] of each position, as it is before nodes merge */
    int *supernode_of;         /* [block_count] of each position, in the end */
    int *list, *scratch[2];    /* [block_count] */
    dgfemi_node *nodes;        /* [block_count] */
    int node_count;
} dgfemi_analysis;

static int dgfemi_analysis_allocate(dgfemi_analysis *a, dgfemi_arena *arena) {
    int **arrays[10];
    size_t n = (size_t)a->graph.count;
    int i;
    arrays[0] = &a->order, arrays[1] = &a->position, arrays[2] = &a->parent;
    arrays[3] = &a->below, arrays[4] = &a->below_blocks, arrays[5] = &a->node_of;
    arrays[6] = &a->supernode_of, arrays[7] = &a->list, arrays[8] = &a->scratch[0], arrays[9] = &a->scratch[1];
    for (i = 0; i < 10; i++) {
        *arrays[i] = (int *)dgfemi_arena_allocate(arena, n, sizeof(int));
        if (!*arrays[i]) return 0;
    }
    a->nodes = (dgfemi_node *)dgfemi_arena_allocate_zero(arena, n, sizeof(dgfemi_node));
    return a->nodes != NULL;
}

/* Puts the order into postorder of its elimination tree, which makes the columns of a supernode neighbours and changes
   nothing else; tree and counts are then those of the new order. */
static void dgfemi_analyse_tree(dgfemi_analysis *a) {
    int n = a->graph.count, *old_parent = a->scratch[1], k;
    dgfemi_counting scratch;
    dgfemi_elimination_tree(&a->graph, a->order, a->position, a->parent, a->scratch[0]);
    dgfemi_postorder(n, a->parent, a->scratch[0], a->scratch[1], a->list);
    memcpy(old_parent, a->parent, (size_t)n * sizeof *old_parent);
    for (k = 0; k < n; k++) a->scratch[0][k] = a->order[a->list[k]];
    memcpy(a->order, a->scratch[0], (size_t)n * sizeof *a->order);
    for (k = 0; k < n; k++) a->scratch[0][a->list[k]] = k;
    for (k = 0; k < n; k++) {
        int up = old_parent[a->list[k]];
        a->parent[k] = up == DGFEM_NONE ? DGFEM_NONE : a->scratch[0][up];
        a->position[a->order[k]] = k;
    }
    for (k = 0; k < n; k++) a->list[k] = k;
    scratch.first = a->node_of, scratch.latest = a->supernode_of;
    scratch.leaf = a->scratch[0], scratch.ancestor = a->scratch[1];
    dgfemi_column_counts(&a->graph, a->order, a->position, a->parent, a->list, &scratch, a->below, a->below_blocks);
}

/* Column k has the rows of column k + 1 and that one's diagonal block: they count as one. */
static int dgfemi_continues_node(const dgfemi_analysis *a, int k) {
    return a->parent[k] == k + 1 && a->below[k] == a->below[k + 1] + a->graph.weight[a->order[k + 1]];
}

/* Nodes and, in a->parent, their tree. */
static void dgfemi_make_nodes(dgfemi_analysis *a) {
    int n = a->graph.count, k, i;
    a->node_count = 0;
    for (k = 0; k < n; k++) {
        dgfemi_node *node = a->nodes + a->node_count;
        if (node->width == 0) node->first = k;
        node->width += a->graph.weight[a->order[k]];
        a->node_of[k] = a->node_count;
        if (k + 1 < n && dgfemi_continues_node(a, k)) continue;
        node->end = k + 1;
        node->height = a->below[k];
        node->blocks = a->below_blocks[k];
        node->child = node->sibling = node->next_segment = DGFEM_NONE;
        node->segment = node->last_segment = a->node_count++;
    }
    for (i = 0; i < a->node_count; i++) { /* i <= nodes[i].first: what is overwritten has been read */
        int up = a->parent[a->nodes[i].end - 1];
        a->parent[i] = up == DGFEM_NONE ? DGFEM_NONE : a->node_of[up];
    }
    for (i = a->node_count - 1; i >= 0; i--)
        if (a->parent[i] != DGFEM_NONE) {
            a->nodes[i].sibling = a->nodes[a->parent[i]].child;
            a->nodes[a->parent[i]].child = i;
        }
}

/* Merging a child into its parent makes all its columns as long as the parent's: wider panels and fewer updates for a
   few more zeros. The limits are by measurement. */
static int dgfemi_worth_merging(double width, double height, double zeros) {
    double entries = width * (width + 1) / 2 + width * height;
    if (width <= 16) return 1;
    if (width <= 48) return zeros < 0.2 * entries;
    if (width <= 96) return zeros < 0.1 * entries;
    return zeros < 0.03 * entries;
}

static int dgfemi_try_merging(dgfemi_analysis *a, int child, int parent) {
    dgfemi_node *c = a->nodes + child, *p = a->nodes + parent;
    double added = (double)c->width * ((double)p->width + p->height - c->height);
    double zeros = c->zeros + p->zeros + added;
    if (!dgfemi_worth_merging((double)c->width + p->width, p->height, zeros)) return 0;
    p->zeros = zeros;
    p->width += c->width;
    a->nodes[c->last_segment].next_segment = p->segment;
    p->segment = c->segment;
    a->parent[child] = DGFEM_MERGED;
    return 1;
}

/* Bottom up, so that what merges has merged with its own children before. */
static void dgfemi_merge_nodes(dgfemi_analysis *a) {
    int p, next;
    for (p = 0; p < a->node_count; p++) {
        int pending = a->nodes[p].child;
        a->nodes[p].child = DGFEM_NONE;
        while (pending != DGFEM_NONE) {
            int c = pending;
            pending = a->nodes[c].sibling;
            if (dgfemi_try_merging(a, c, p)) {
                int grandchild = a->nodes[c].child;
                for (; grandchild != DGFEM_NONE; grandchild = next) { /* are the parent's children now */
                    next = a->nodes[grandchild].sibling;
                    a->parent[grandchild] = p;
                    a->nodes[grandchild].sibling = pending;
                    pending = grandchild;
                }
            } else {
                a->nodes[c].sibling = a->nodes[p].child;
                a->nodes[p].child = c;
            }
        }
    }
}

/* ---- what the factorization follows ---- */

/* Gives the blocks their final places: node after node as listed, and in each the columns merged into it before its
   own. */
static void dgfemi_place_blocks(dgfem_cholesky *c, dgfemi_analysis *a) {
    int *order = a->below; /* done with */
    int placed = 0, s, i, k;
    for (s = 0; s < c->supernode_count; s++) {
        c->supernodes[s].first = placed;
        for (i = a->nodes[a->list[s]].segment; i != DGFEM_NONE; i = a->nodes[i].next_segment)
            for (k = a->nodes[i].first; k < a->nodes[i].end; k++) {
                a->supernode_of[placed] = s;
                order[placed++] = a->order[k];
            }
        c->supernodes[s].last = placed;
    }
    for (k = 0; k < placed; k++) {
        a->order[k] = order[k];
        a->position[order[k]] = k;
    }
}

/* Supernodes from the nodes that are left, and the final order. 0 when out of memory. */
static int dgfemi_make_supernodes(dgfem_cholesky *c, dgfemi_analysis *a) {
    int *supernode_of_node = a->below_blocks; /* done with: the nodes have their counts */
    int column = 0, s;
    double rows = 0;
    c->supernode_count = dgfemi_postorder(a->node_count, a->parent, a->scratch[0], a->scratch[1], a->list);
    c->supernodes =
        (dgfemi_supernode *)dgfemi_allocate_zero(&c->hooks, (size_t)c->supernode_count, sizeof *c->supernodes);
    if (!c->supernodes) return 0;
    for (s = 0; s < c->supernode_count; s++) supernode_of_node[a->list[s]] = s;
    dgfemi_place_blocks(c, a);
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        const dgfemi_node *node = a->nodes + a->list[s];
        int parent = a->parent[a->list[s]];
        super->parent = parent == DGFEM_NONE ? DGFEM_NONE : supernode_of_node[parent];
        super->child = super->sibling = DGFEM_NONE;
        super->column = column;
        super->width = node->width;
        super->height = node->height;
        column += node->width;
        super->row_start = super->row_end = (int)rows;
        rows += node->blocks;
        if (rows > INT_MAX) return 0;
    }
    c->rows = (int *)dgfemi_allocate(&c->hooks, (size_t)rows, sizeof(int));
    return c->rows != NULL;
}

/* Children in ascending order. */
static void dgfemi_link_children(dgfem_cholesky *c) {
    int s;
    for (s = c->supernode_count - 1; s >= 0; s--) {
        dgfemi_supernode *super = c->supernodes + s;
        if (super->parent == DGFEM_NONE) continue;
        super->sibling = c->supernodes[super->parent].child;
        c->supernodes[super->parent].child = s;
    }
}

/* Row i of L reaches the supernodes on the way from its neighbours in A up the tree to its own. Rows are visited in
   ascending order, and so enter each list. */
static void dgfemi_make_rows(dgfem_cholesky *c, dgfemi_analysis *a) {
    const dgfemi_graph *graph = &a->graph;
    int *mark = a->scratch[0], i, k, s;
    for (s = 0; s < c->supernode_count; s++) mark[s] = DGFEM_NONE;
    for (i = 0; i < graph->count; i++) {
        int v = a->order[i];
        mark[a->supernode_of[i]] = i;
        for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
            int j = a->position[graph->neighbour[k]];
            if (j > i) continue;
            for (s = a->supernode_of[j]; mark[s] != i; s = c->supernodes[s].parent) {
                mark[s] = i;
                c->rows[c->supernodes[s].row_end++] = i;
            }
        }
    }
}

/* The row in a supernode's front of each position that has one. */
static void dgfemi_map_front(const dgfem_cholesky *c, const dgfemi_supernode *super, int *front_row) {
    int row = super->width, i;
    for (i = super->first; i < super->last; i++) front_row[i] = c->offset[i] - super->column;
    for (i = super->row_start; i < super->row_end; i++) {
        front_row[c->rows[i]] = row;
        row += c->offset[c->rows[i] + 1] - c->offset[c->rows[i]];
    }
}

/* Appends a run, or makes the last one since `first` longer. Returns the number of runs made by now. */
static int dgfemi_add_run(dgfemi_run *runs, int first, int used, int row, int front_row, int length, int joins) {
    if (joins && used > first) {
        runs[used - 1].length += length;
        return used;
    }
    runs[used].row = row;
    runs[used].front_row = front_row;
    runs[used].length = length;
    return used + 1;
}

/* Where the rows below a supernode go in its parent's front, by runs and by segments. `used` are the numbers of both
   that were made by now. */
static void dgfemi_make_runs(dgfem_cholesky *c, dgfemi_supernode *super, const int *front_row, int used[2]) {
    int width = c->supernodes[super->parent].width, strip = c->kernels->strip, row = 0, k;
    super->run_start = super->run_middle = used[0];
    super->segment_start = super->segment_middle = used[1];
    for (k = super->row_start; k < super->row_end; k++) {
        int i = c->rows[k], left = c->offset[i + 1] - c->offset[i], to = front_row[i], joins = 0;
        if (used[0] > super->run_start) {
            const dgfemi_run *last = c->runs + used[0] - 1;
            joins = last->front_row + last->length == to && to != width;
        }
        used[0] = dgfemi_add_run(c->runs, super->run_start, used[0], row, to, left, joins);
        if (to < width) super->run_middle = used[0];
        while (left > 0) {
            int place = to < width ? to : to - width, length = strip - place % strip;
            if (length > strip - row % strip) length = strip - row % strip;
            if (length > left) length = left;
            used[1] = dgfemi_add_run(c->segments, super->segment_start, used[1], row, to, length,
                                     joins && row % strip != 0 && place % strip != 0);
            if (to < width) super->segment_middle = used[1];
            row += length, to += length, left -= length, joins = 1;
        }
    }
    super->run_end = used[0];
    super->segment_end = used[1];
}

/* Where the stored blocks of A go that a supernode's columns begin with: those that couple its blocks to themselves and
   to later ones. Returns the number of entries made by now. */
static int dgfemi_make_entries(dgfem_cholesky *c, dgfemi_supernode *super, const dgfemi_analysis *a,
                               const dgfem_matrix *matrix, const int *front_row, int used) {
    const dgfemi_graph *graph = &a->graph;
    int i, k;
    super->entry_start = used;
    for (i = super->first; i < super->last; i++) {
        int v = a->order[i];
        for (k = graph->start[v]; k <= graph->start[v + 1]; k++) {
            int u = k < graph->start[v + 1] ? graph->neighbour[k] : v; /* at last the diagonal block */
            dgfemi_entry *entry = c->entries + used;
            if (a->position[u] < i) continue;
            entry->block = u == v ? dgfemi_diagonal_index(matrix, v) : graph->block[k];
            entry->rows = graph->weight[u > v ? u : v];
            entry->columns = graph->weight[u > v ? v : u];
            entry->front_row = front_row[a->position[u]];
            entry->front_column = front_row[i];
            entry->transposed = u < v;
            used++;
        }
    }
    super->entry_end = used;
    return used;
}

/* 0 when out of memory. */
static int dgfemi_make_fronts(dgfem_cholesky *c, const dgfemi_analysis *a, const dgfem_matrix *matrix) {
    int *front_row = a->scratch[0], rows = 0, used[2] = {0, 0}, entries = 0, s, t, k;
    double segments = 0;
    for (s = 0; s < c->supernode_count; s++)
        for (k = c->supernodes[s].row_start; k < c->supernodes[s].row_end; k++, rows++)
            segments += 3 + 2 * (double)((c->offset[c->rows[k] + 1] - c->offset[c->rows[k]]) / c->kernels->strip);
    if (segments > INT_MAX) return 0;
    c->runs = (dgfemi_run *)dgfemi_allocate(&c->hooks, (size_t)rows, sizeof *c->runs);
    c->segments = (dgfemi_run *)dgfemi_allocate(&c->hooks, (size_t)segments, sizeof *c->segments);
    c->entries =
        (dgfemi_entry *)dgfemi_allocate(&c->hooks, (size_t)matrix->row_start[matrix->block_count], sizeof *c->entries);
    if (!c->runs || !c->segments || !c->entries) return 0;
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        dgfemi_map_front(c, super, front_row);
        entries = dgfemi_make_entries(c, super, a, matrix, front_row, entries);
        for (t = super->child; t != DGFEM_NONE; t = c->supernodes[t].sibling)
            dgfemi_make_runs(c, c->supernodes + t, front_row, used);
    }
    return 1;
}

/* ---- tasks and memory ---- */

#define DGFEM_TASKS 24.0      /* about as many, for a few workers to share evenly */
#define DGFEM_CACHE_LINE 64   /* bytes */
#define DGFEM_TASK_FLOPS 2e6  /* less is not worth a task of its own */
#define DGFEM_FRONT_FLOPS 4e6 /* less is not worth sharing a front */

static int dgfemi_whole_strips(int rows, int strip) { return rows / strip + (rows % strip != 0); }

static double dgfemi_front_flops(const dgfemi_supernode *super) {
    double w = super->width, h = super->height;
    return w * (w * w / 3 + w * h + h * h);
}

/* The flops of all subtrees. Returns the sum. */
static double dgfemi_count_flops(dgfem_cholesky *c) {
    double total = 0;
    int s;
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        super->flops += dgfemi_front_flops(super);
        if (super->parent == DGFEM_NONE) total += super->flops;
        else c->supernodes[super->parent].flops += super->flops;
    }
    return total;
}

/* The largest first, so that the small ones fill the gaps at the end. */
static int dgfemi_compare_tasks(const void *a, const void *b) {
    const dgfemi_task *s = (const dgfemi_task *)a, *t = (const dgfemi_task *)b;
    if (s->flops != t->flops) return s->flops > t->flops ? -1 : 1;
    return s->first - t->first;
}

/* Cuts the forest: supernodes whose subtrees are large stay above the cut, what hangs below goes to the tasks, several
   subtrees to one where they are small. How fronts are distributed changes no bit of the result. 0 when out of
   memory. */
static int dgfemi_make_tasks(dgfem_cholesky *c) {
    double limit = dgfemi_count_flops(c) / DGFEM_TASKS;
    dgfemi_task *task = NULL;
    int first = 0, s, k;
    if (limit < DGFEM_TASK_FLOPS) limit = DGFEM_TASK_FLOPS;
    if (!c->hooks.parallel_for) limit = DGFEM_TASKS * limit; /* one task, whose updates need less memory */
    c->tasks = (dgfemi_task *)dgfemi_allocate_zero(&c->hooks, (size_t)c->supernode_count, sizeof *c->tasks);
    if (!c->tasks) return 0;
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        super->task = DGFEM_NONE;
        if (super->flops > limit) {
            task = NULL;
            first = s + 1;
        } else if (super->parent == DGFEM_NONE || c->supernodes[super->parent].flops > limit) {
            if (!task || task->flops + super->flops > limit) {
                task = c->tasks + c->task_count++;
                task->first = first;
            }
            task->last = first = s + 1;
            task->flops += super->flops;
        }
    }
    if (c->task_count > 1) qsort(c->tasks, (size_t)c->task_count, sizeof *c->tasks, dgfemi_compare_tasks);
    for (k = 0; k < c->task_count; k++)
        for (s = c->tasks[k].first; s < c->tasks[k].last; s++) c->supernodes[s].task = k;
    return 1;
}

/* Reals of `rows` rows of a lower triangle in strips, the last of which ends with the last column. */
static size_t dgfemi_triangle_size(int rows, int strip) {
    size_t whole = rows > 0 ? (size_t)((rows - 1) / strip) : 0, size = (size_t)strip;
    size_t before = whole % 2 ? dgfemi_add_product(0, whole * size, (whole + 1) / 2 * size)
                              : dgfemi_add_product(0, whole / 2 * size, (whole + 1) * size);
    return dgfemi_add_product(before, size, (size_t)rows);
}

/* A panel's reals. */
static size_t dgfemi_panel_size(const dgfem_cholesky *c, const dgfemi_supernode *super) {
    int strip = c->kernels->strip;
    return dgfemi_add_product(dgfemi_triangle_size(super->width, strip), (size_t)super->width,
                              (size_t)dgfemi_whole_strips(super->height, strip) * (size_t)strip);
}

/* Tiles may write beyond the last column, up to the end of the strip's own rows. */
static size_t dgfemi_update_size(const dgfem_cholesky *c, const dgfemi_supernode *super) {
    int strip = c->kernels->strip;
    return dgfemi_triangle_size(dgfemi_whole_strips(super->height, strip) * strip, strip);
}

/* Places the updates that the supernodes of one task (or those above all tasks) pass to each other on two stacks, for
   even and odd depths, that grow towards each other: a front writes its own to one while those of its children are still
   on the other, and then drops them from the top. Returns where the memory after them begins. */
static size_t dgfemi_place_updates(dgfem_cholesky *c, int first, int last, int task, const int *odd, size_t used) {
    size_t top[2] = {0, 0}, most = 0;
    int s, t;
    for (s = first; s < last; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        int own = odd[s];
        if (super->task != task) continue;
        for (t = super->child; t != DGFEM_NONE; t = c->supernodes[t].sibling)
            if (c->supernodes[t].task == task) break;
        if (super->parent != DGFEM_NONE && c->supernodes[super->parent].task == task) {
            super->update = top[own];
            top[own] = dgfemi_add_product(top[own], dgfemi_update_size(c, super), 1);
            if (dgfemi_add_product(top[0], top[1], 1) > most) most = dgfemi_add_product(top[0], top[1], 1);
        }
        if (t != DGFEM_NONE) top[!own] = c->supernodes[t].update; /* of the first child of the same kind */
    }
    used = dgfemi_add_product(used, most, 1);
    for (s = first; s < last; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        if (super->task != task || super->parent == DGFEM_NONE || c->supernodes[super->parent].task != task) continue;
        if (odd[s]) super->update = used - super->update - dgfemi_update_size(c, super);
        else super->update = used - most + super->update;
    }
    return used;
}

/* Places the panels of supernodes with or without a task. Returns where the memory after them begins. */
static size_t dgfemi_place_panels(dgfem_cholesky *c, int in_task, size_t used) {
    int s;
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        if ((super->task != DGFEM_NONE) != in_task) continue;
        super->values = used;
        used = dgfemi_add_product(used, dgfemi_panel_size(c, super), 1);
    }
    return used;
}

/* Places panels and updates in one piece of memory. Returns the room they need.

       panels of tasks | panels above all tasks, updates above | what tasks pass on to those above
                       | updates within tasks                  |

   Before all tasks are done nothing is written above them, and then the updates within tasks are no longer needed. */
static size_t dgfemi_plan_fronts(dgfem_cholesky *c, int *odd) {
    size_t within = dgfemi_place_panels(c, 1, 0), above = dgfemi_place_panels(c, 0, within), used;
    int s, k;
    for (s = c->supernode_count - 1; s >= 0; s--) {
        int parent = c->supernodes[s].parent;
        odd[s] = parent != DGFEM_NONE && !odd[parent];
    }
    for (k = 0; k < c->task_count; k++)
        within = dgfemi_place_updates(c, c->tasks[k].first, c->tasks[k].last, k, odd, within);
    above = dgfemi_place_updates(c, 0, c->supernode_count, DGFEM_NONE, odd, above);
    used = within > above ? within : above;
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        if (super->parent == DGFEM_NONE || c->supernodes[super->parent].task == super->task) continue;
        super->update = used;
        used = dgfemi_add_product(used, dgfemi_update_size(c, super), 1);
    }
    return used;
}

/* Fronts whose update is left to BLAS where there is one. */
static int dgfemi_is_for_blas(const dgfemi_supernode *super) {
#ifdef DGFEM_USE_BLAS
    return super->width >= 48 && super->height >= 192;
#else
    (void)super;
    return 0;
#endif
}

/* Takes `count` reals, in whole cache lines, from the front of memory still to be allocated. Returns where they are. */
static size_t dgfemi_reserve(size_t *used, size_t count) {
    size_t start = *used, line = DGFEM_CACHE_LINE / sizeof(dgfem_real);
    *used = dgfemi_add_product(start, count / line + 1, line);
    return start;
}

/* Reserves what factorizations and solves need. 0 when out of memory. */
static int dgfemi_plan_memory(dgfem_cholesky *c, const dgfemi_analysis *a) {
    int strip = c->kernels->strip, s, own = 0, below = 0;
    size_t start[7], values, packed = 0, used = 0;
    dgfem_real *base;
    for (s = 0; s < c->supernode_count; s++) {
        const dgfemi_supernode *super = c->supernodes + s;
        int d = dgfemi_whole_strips(super->width, strip), b = dgfemi_whole_strips(super->height, strip);
        if (d > own) own = d;
        if (b > below) below = b;
        if (dgfemi_is_for_blas(super) && (size_t)super->width * (size_t)super->height > packed)
            packed = (size_t)super->width * (size_t)super->height;
    }
    /* a tile at the edge of the last panel may read, but not use, what is behind it */
    values = dgfemi_plan_fronts(c, a->scratch[0]);
    start[0] = dgfemi_reserve(&used, dgfemi_add_product(values, (size_t)strip, (size_t)c->kernels->tile));
    start[1] = dgfemi_reserve(&used, (size_t)own * (size_t)strip);
    start[2] = dgfemi_reserve(&used, (size_t)below * (size_t)strip);
    start[3] = dgfemi_reserve(&used, dgfemi_add_product(0, (size_t)c->size, DGFEM_SOLVES));
    start[4] = dgfemi_reserve(&used, (size_t)c->size);
    start[5] = dgfemi_reserve(&used, packed);
    start[6] = dgfemi_reserve(&used, dgfemi_add_product(0, (size_t)own * (size_t)strip, (size_t)c->kernels->lanes));
    used = dgfemi_add_product(used, DGFEM_CACHE_LINE / sizeof(dgfem_real), 1);
    c->memory = dgfemi_allocate(&c->hooks, used, sizeof(dgfem_real));
    if (!c->memory) return 0;
    base = (dgfem_real *)(((uintptr_t)c->memory + DGFEM_CACHE_LINE - 1) & ~(uintptr_t)(DGFEM_CACHE_LINE - 1));
    memset(base + start[0] + values, 0, (size_t)strip * (size_t)c->kernels->tile * sizeof *base);
    c->values = base + start[0], c->own = base + start[1], c->below = base + start[2], c->x = base + start[3];
    c->diagonal = base + start[4], c->packed = base + start[5], c->sums = base + start[6];
    return 1;
}

/* Needs the final order. 0 when out of memory. */
static int dgfemi_make_offsets(dgfem_cholesky *c, const dgfemi_analysis *a, const dgfem_matrix *matrix) {
    int n = c->block_count, k;
    c->order = (int *)dgfemi_duplicate(&c->hooks, a->order, (size_t)n, sizeof(int));
    c->offset = (int *)dgfemi_allocate(&c->hooks, (size_t)n + 1, sizeof(int));
    c->source = (int *)dgfemi_allocate(&c->hooks, (size_t)n, sizeof(int));
    if (!c->order || !c->offset || !c->source) return 0;
    c->offset[0] = 0;
    for (k = 0; k < n; k++) {
        c->offset[k + 1] = c->offset[k] + a->graph.weight[a->order[k]];
        c->source[k] = matrix->offset[a->order[k]];
    }
    return 1;
}

/* FNV-1a over all that makes the pattern. */
static uint64_t dgfemi_pattern_hash(const dgfem_matrix *matrix) {
    const int *arrays[3];
    size_t lengths[3], i;
    uint64_t hash = 14695981039346656037u;
    int k;
    arrays[0] = matrix->offset, lengths[0] = (size_t)matrix->block_count + 1;
    arrays[1] = matrix->row_start, lengths[1] = (size_t)matrix->block_count + 1;
    arrays[2] = matrix->column, lengths[2] = (size_t)matrix->row_start[matrix->block_count];
    for (k = 0; k < 3; k++)
        for (i = 0; i < lengths[k]; i++) hash = (hash ^ (uint64_t)arrays[k][i]) * 1099511628211u;
    return hash;
}

/* 0 when out of memory. */
static int dgfemi_analyse(dgfem_cholesky *c, const dgfem_matrix *matrix, dgfem_ordering ordering, dgfemi_arena *arena) {
    dgfemi_analysis analysis, *a = &analysis;
    if (!dgfemi_graph_make(arena, matrix, &a->graph) || !dgfemi_analysis_allocate(a, arena)) return 0;
    if (!dgfemi_order_blocks(arena, &a->graph, matrix->centres, ordering, a->order)) return 0;
    dgfemi_analyse_tree(a);
    dgfemi_factor_cost(&a->graph, a->order, a->below, &c->factor_entries, &c->factor_flops);
    dgfemi_make_nodes(a);
    dgfemi_merge_nodes(a);
    if (!dgfemi_make_supernodes(c, a) || !dgfemi_make_offsets(c, a, matrix)) return 0;
    dgfemi_link_children(c);
    dgfemi_make_rows(c, a);
    return dgfemi_make_fronts(c, a, matrix) && dgfemi_make_tasks(c) && dgfemi_plan_memory(c, a);
}
