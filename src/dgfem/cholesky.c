#pragma once
#include "ordering.c"
#include "panel.c"
/* Sparse Cholesky factorization A = L L^T of matrices in blocks: symbolic analysis, multifrontal factorization, solves.

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
    int run_start, run_end;     /* where they go in the parent's front, in dgfem_cholesky.runs */
    int entry_start, entry_end; /* the blocks of A that its columns begin with, in dgfem_cholesky.entries */
    size_t values;              /* its panel, in dgfem_cholesky.values */
    size_t update;              /* its U, in dgfem_cholesky.updates */
} dgfemi_supernode;

/* Consecutive rows below a supernode that are consecutive in the parent's front too, on one side of its width. */
typedef struct dgfemi_run {
    int row, front_row, length;
} dgfemi_run;

/* A stored block of A and where it goes in a front: as it is, or transposed where the order of elimination swaps its
   row and column. */
typedef struct dgfemi_entry {
    int block, rows, columns;
    int front_row, front_column, transposed;
} dgfemi_entry;

struct dgfem_cholesky {
    dgfem_hooks hooks;
    int block_count, size;
    uint64_t pattern; /* hash of the pattern analysed */
    int factored;     /* 1: values hold a factorization */
    int *order;       /* [block_count] the block at each position */
    int *offset;      /* [block_count + 1] first unknown of each position, in the order of elimination */
    int *source;      /* [block_count] first unknown of each position, in the order of the matrix */
    int supernode_count;
    dgfemi_supernode *supernodes; /* children before parents */
    int *rows;                    /* positions */
    dgfemi_run *runs;
    dgfemi_entry *entries;
    dgfem_real *values;   /* L */
    dgfem_real *panel;    /* one front's D and B while they are assembled: column-major */
    dgfem_real *updates;  /* the U that still wait for their parents: lower halves, packed by columns */
    dgfem_real *diagonal; /* [largest width] of A, in the front's columns */
    dgfem_real *x;        /* [size] a solve's vector in the order of elimination */
    dgfem_real *below;    /* [largest height, in whole strips] the part of it below a supernode */
    double factor_entries, factor_flops;
};

/* ---- symbolic analysis: the elimination tree and its supernodes ---- */

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

/* Lists the nodes of a forest, children before parents, each tree in one piece. child and sibling are scratch. Returns
   their number: nodes whose parent is DGFEM_MERGED do not count. */
static int dgfemi_postorder(int count, const int *parent, int *child, int *sibling, int *list) {
    int listed = 0, root, k;
    for (k = 0; k < count; k++) child[k] = DGFEM_NONE;
    for (k = count - 1; k >= 0; k--)
        if (parent[k] >= 0) {
            sibling[k] = child[parent[k]];
            child[parent[k]] = k;
        }
    for (root = 0; root < count; root++) {
        if (parent[root] != DGFEM_NONE) continue;
        for (k = root;;) {
            int next = child[k];
            if (next != DGFEM_NONE) { /* down to a child that has not been listed */
                child[k] = sibling[next];
                k = next;
                continue;
            }
            list[listed++] = k;
            if (k == root) break;
            k = parent[k];
        }
    }
    return listed;
}

/* Puts the order into postorder of its elimination tree, which makes the columns of a supernode neighbours and changes
   nothing else; tree and counts are then those of the new order. */
static void dgfemi_analyse_tree(dgfemi_analysis *a) {
    int n = a->graph.count, k;
    dgfemi_elimination_tree(&a->graph, a->order, a->position, a->parent, a->scratch[0]);
    dgfemi_postorder(n, a->parent, a->scratch[0], a->scratch[1], a->list);
    for (k = 0; k < n; k++) a->scratch[0][k] = a->order[a->list[k]];
    memcpy(a->order, a->scratch[0], (size_t)n * sizeof *a->order);
    dgfemi_elimination_tree(&a->graph, a->order, a->position, a->parent, a->scratch[0]);
    dgfemi_column_counts(&a->graph, a->order, a->position, a->parent, a->scratch[0], a->below, a->below_blocks);
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

/* ---- symbolic analysis: what the factorization follows ---- */

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

/* Where the rows below a supernode go in its parent's front. Returns the number of runs made by now. */
static int dgfemi_make_runs(dgfem_cholesky *c, dgfemi_supernode *super, const int *front_row, int used) {
    int width = c->supernodes[super->parent].width, row = 0, k;
    super->run_start = used;
    for (k = super->row_start; k < super->row_end; k++) {
        int i = c->rows[k], length = c->offset[i + 1] - c->offset[i];
        dgfemi_run *run = c->runs + used;
        if (used > super->run_start && run[-1].front_row + run[-1].length == front_row[i] && front_row[i] != width)
            run[-1].length += length;
        else {
            run->row = row;
            run->front_row = front_row[i];
            run->length = length;
            used++;
        }
        row += length;
    }
    super->run_end = used;
    return used;
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
    int *front_row = a->scratch[0], rows = 0, runs = 0, entries = 0, s, t;
    if (c->supernode_count > 0) rows = c->supernodes[c->supernode_count - 1].row_end;
    c->runs = (dgfemi_run *)dgfemi_allocate(&c->hooks, (size_t)rows, sizeof *c->runs);
    c->entries =
        (dgfemi_entry *)dgfemi_allocate(&c->hooks, (size_t)matrix->row_start[matrix->block_count], sizeof *c->entries);
    if (!c->runs || !c->entries) return 0;
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        dgfemi_map_front(c, super, front_row);
        entries = dgfemi_make_entries(c, super, a, matrix, front_row, entries);
        for (t = super->child; t != DGFEM_NONE; t = c->supernodes[t].sibling)
            runs = dgfemi_make_runs(c, c->supernodes + t, front_row, runs);
    }
    return 1;
}

/* Reserves what factorizations and solves need. Update matrices lie on two stacks, for even and odd depths of the tree:
   a front writes its own to one while those of its children are still on the other, and then drops them from the top.
   0 when out of memory. */
static int dgfemi_plan_memory(dgfem_cholesky *c, const dgfemi_analysis *a) {
    int *stack = a->scratch[0], width = 0, strips = 0, s, t;
    size_t values = 0, panel = 0, top[2] = {0, 0}, peak[2] = {0, 0};
    for (s = c->supernode_count - 1; s >= 0; s--)
        stack[s] = c->supernodes[s].parent == DGFEM_NONE ? 0 : !stack[c->supernodes[s].parent];
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_supernode *super = c->supernodes + s;
        size_t w = (size_t)super->width, h = (size_t)super->height, *own = top + stack[s], *other = top + !stack[s];
        size_t front = dgfemi_add_product(0, w, w + h);
        int below = dgfemi_strips(super->height);
        super->values = values;
        values = dgfemi_add_product(values, w, (size_t)(dgfemi_strips(super->width) + below) * DGFEM_STRIP);
        super->update = *own;
        *own = h % 2 ? dgfemi_add_product(*own, h, (h + 1) / 2) : dgfemi_add_product(*own, h / 2, h + 1);
        for (t = super->child; t != DGFEM_NONE; t = c->supernodes[t].sibling)
            if (c->supernodes[t].update < *other) *other = c->supernodes[t].update;
        if (*own > peak[stack[s]]) peak[stack[s]] = *own;
        if (front > panel) panel = front;
        if (super->width > width) width = super->width;
        if (below > strips) strips = below;
    }
    for (s = 0; s < c->supernode_count; s++)
        if (stack[s]) c->supernodes[s].update += peak[0];
    c->values = (dgfem_real *)dgfemi_allocate(&c->hooks, values, sizeof(dgfem_real));
    c->panel = (dgfem_real *)dgfemi_allocate(&c->hooks, panel, sizeof(dgfem_real));
    c->updates = (dgfem_real *)dgfemi_allocate(&c->hooks, dgfemi_add_product(peak[0], peak[1], 1), sizeof(dgfem_real));
    c->diagonal = (dgfem_real *)dgfemi_allocate(&c->hooks, (size_t)width, sizeof(dgfem_real));
    c->x = (dgfem_real *)dgfemi_allocate(&c->hooks, (size_t)c->size, sizeof(dgfem_real));
    c->below = (dgfem_real *)dgfemi_allocate(&c->hooks, (size_t)strips * DGFEM_STRIP, sizeof(dgfem_real));
    return c->values && c->panel && c->updates && c->diagonal && c->x && c->below;
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
    return dgfemi_make_fronts(c, a, matrix) && dgfemi_plan_memory(c, a);
}

DGFEM_API dgfem_cholesky_desc dgfem_default_cholesky_desc(void) {
    dgfem_cholesky_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.ordering = DGFEM_ORDERING_AUTO;
    return desc;
}

DGFEM_API dgfem_status dgfem_cholesky_create(const dgfem_matrix *matrix, const dgfem_cholesky_desc *desc,
                                             dgfem_cholesky **out) {
    dgfemi_arena arena;
    dgfem_cholesky *c;
    dgfem_status status;
    int analysed = 0;
    if (out) *out = NULL;
    status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    if (!matrix || !out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: matrix or out is NULL");
    if ((int)desc->ordering < 0 || desc->ordering > DGFEM_ORDERING_NESTED_DISSECTION)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: unknown ordering %d", (int)desc->ordering);
    if (desc->ordering == DGFEM_ORDERING_NESTED_DISSECTION && !matrix->centres)
        return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: nested dissection needs the blocks' centres");
    c = (dgfem_cholesky *)dgfemi_allocate_zero(&desc->hooks, 1, sizeof *c);
    if (c) {
        c->hooks = desc->hooks;
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
    dgfemi_free(&hooks, c->entries);
    dgfemi_free(&hooks, c->values);
    dgfemi_free(&hooks, c->panel);
    dgfemi_free(&hooks, c->updates);
    dgfemi_free(&hooks, c->diagonal);
    dgfemi_free(&hooks, c->x);
    dgfemi_free(&hooks, c->below);
    dgfemi_free(&hooks, c);
}

/* ---- numeric factorization ---- */

/* Adds one block of A to the front; of diagonal blocks the lower half. */
static void dgfemi_add_entry(const dgfemi_entry *entry, const dgfem_real *block, dgfem_real *panel, size_t stride) {
    dgfem_real *to = panel + (size_t)entry->front_column * stride + entry->front_row;
    int diagonal = entry->front_row == entry->front_column, i, j;
    if (entry->transposed) {
        for (i = 0; i < entry->rows; i++, block += entry->columns, to += stride)
            for (j = 0; j < entry->columns; j++) to[j] = block[j];
    } else {
        for (j = 0; j < entry->columns; j++, to += stride)
            for (i = diagonal ? j : 0; i < entry->rows; i++)
                to[i] = block[(size_t)i * (size_t)entry->columns + (size_t)j];
    }
}

/* Adds the columns of a child's update that belong to the front's panel (column-major, width + height rows), or those
   that belong to its own update. */
static void dgfemi_add_child(const dgfem_cholesky *c, const dgfemi_supernode *super, const dgfemi_supernode *child,
                             int in_panel) {
    const dgfem_real *from = c->updates + child->update;
    int target, k, j;
    for (target = child->run_start; target < child->run_end; target++) {
        const dgfemi_run *columns = c->runs + target;
        if ((columns->front_row < super->width) != in_panel) continue;
        for (j = 0; j < columns->length; j++) {
            const dgfem_real *source = from + dgfemi_packed(child->height, columns->row + j);
            int column = columns->front_row + j, skip = j; /* of the first run: what is above the diagonal */
            dgfem_real *to;
            int shift = in_panel ? 0 : super->width;
            if (in_panel) to = c->panel + (size_t)column * ((size_t)super->width + (size_t)super->height);
            else to = c->updates + super->update + dgfemi_packed(super->height, column - shift);
            for (k = target; k < child->run_end; k++, skip = 0) {
                const dgfemi_run *rows = c->runs + k;
                dgfemi_add_vector(to + (rows->front_row - shift + skip), source + rows->row + skip,
                                  rows->length - skip);
            }
        }
    }
}

/* Gathers D and B of a front: from A, whose diagonal is kept, and from the children. */
static void dgfemi_assemble(dgfem_cholesky *c, const dgfemi_supernode *super, const dgfem_matrix *matrix) {
    size_t stride = (size_t)super->width + (size_t)super->height;
    int k;
    memset(c->panel, 0, (size_t)super->width * stride * sizeof(dgfem_real));
    for (k = super->entry_start; k < super->entry_end; k++)
        dgfemi_add_entry(c->entries + k, matrix->values + matrix->value_start[c->entries[k].block], c->panel, stride);
    for (k = 0; k < super->width; k++) c->diagonal[k] = c->panel[(size_t)k * (stride + 1)];
    for (k = super->child; k != DGFEM_NONE; k = c->supernodes[k].sibling)
        dgfemi_add_child(c, super, c->supernodes + k, 1);
}

static dgfemi_panel dgfemi_panel_of(const dgfem_cholesky *c, const dgfemi_supernode *super) {
    dgfemi_panel panel;
    panel.values = c->values + super->values;
    panel.width = super->width;
    panel.height = super->height;
    return panel;
}

/* Children come before parents; no front looks at any other than its children. Returns the position whose pivot fails,
   or DGFEM_NONE. */
static int dgfemi_factor(dgfem_cholesky *c, const dgfem_matrix *matrix) {
    int s, t;
    for (s = 0; s < c->supernode_count; s++) {
        const dgfemi_supernode *super = c->supernodes + s;
        dgfemi_panel panel = dgfemi_panel_of(c, super);
        int failed;
        dgfemi_assemble(c, super, matrix);
        dgfemi_pack_panel(&panel, c->panel);
        failed = dgfemi_factor_panel(&panel, c->diagonal);
        if (failed != DGFEM_NONE) {
            for (t = super->first; c->offset[t + 1] <= super->column + failed;) t++;
            return t;
        }
        dgfemi_make_update(&panel, c->updates + super->update);
        for (t = super->child; t != DGFEM_NONE; t = c->supernodes[t].sibling)
            dgfemi_add_child(c, super, c->supernodes + t, 0);
    }
    return DGFEM_NONE;
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

/* The part of x at the rows below a supernode, or what changes it. */
static void dgfemi_add_below(const dgfem_cholesky *c, const dgfemi_supernode *super) {
    const dgfem_real *below = c->below;
    int k;
    for (k = super->row_start; k < super->row_end; k++) {
        int first = c->offset[c->rows[k]], count = c->offset[c->rows[k] + 1] - first;
        dgfemi_add_vector(c->x + first, below, count);
        below += count;
    }
}

static void dgfemi_gather_below(const dgfem_cholesky *c, const dgfemi_supernode *super) {
    dgfem_real *below = c->below;
    int padding = dgfemi_strips(super->height) * DGFEM_STRIP - super->height, k, i;
    for (k = super->row_start; k < super->row_end; k++) {
        int first = c->offset[c->rows[k]], count = c->offset[c->rows[k] + 1] - first;
        for (i = 0; i < count; i++) *below++ = c->x[first + i];
    }
    for (i = 0; i < padding; i++) *below++ = 0;
}

static void dgfemi_solve(const dgfem_cholesky *c, const dgfem_real *b, dgfem_real *x) {
    int s, k, i;
    for (k = 0; k < c->block_count; k++)
        for (i = c->offset[k]; i < c->offset[k + 1]; i++) c->x[i] = b[c->source[k] + i - c->offset[k]];
    for (s = 0; s < c->supernode_count; s++) {
        dgfemi_panel panel = dgfemi_panel_of(c, c->supernodes + s);
        dgfemi_solve_panel(&panel, c->x + c->supernodes[s].column, c->below);
        dgfemi_add_below(c, c->supernodes + s);
    }
    for (s = c->supernode_count - 1; s >= 0; s--) {
        dgfemi_panel panel = dgfemi_panel_of(c, c->supernodes + s);
        dgfemi_gather_below(c, c->supernodes + s);
        dgfemi_solve_panel_transposed(&panel, c->x + c->supernodes[s].column, c->below);
    }
    for (k = 0; k < c->block_count; k++)
        for (i = c->offset[k]; i < c->offset[k + 1]; i++) x[c->source[k] + i - c->offset[k]] = c->x[i];
}

DGFEM_API dgfem_status dgfem_cholesky_solve(const dgfem_cholesky *c, const dgfem_real *b, dgfem_real *x) {
    int bad;
    if (!c) return DGFEM_ERROR_ARGUMENT;
    if (!b || !x) return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: b or x is NULL");
    if (!c->factored) return dgfemi_fail(&c->hooks, DGFEM_ERROR_ARGUMENT, "cholesky: no factorization to solve with");
    bad = dgfemi_vector_not_finite(c->size, b);
    if (bad != DGFEM_NONE) return dgfemi_fail(&c->hooks, DGFEM_ERROR_NOT_FINITE, "cholesky: b[%d]", bad);
    dgfemi_solve(c, b, x);
    return DGFEM_OK;
}
