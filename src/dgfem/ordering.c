#pragma once
#include "linalg.c"
#include "sparse.c"
/* Fill-reducing orderings of the blocks: minimum degree and geometric nested dissection. */

/* ---- graph of the blocks ---- */

/* Vertices are blocks, edges the stored blocks off the diagonal. Neighbours ascend. */
typedef struct dgfemi_graph {
    int count;
    int *start;     /* [count + 1] */
    int *neighbour; /* vertex v: start[v] <= k < start[v + 1] */
    int *block;     /* the edge's stored block in the matrix */
    int *weight;    /* [count] unknowns of the block */
} dgfemi_graph;

/* 0 when out of memory. */
static int dgfemi_graph_make(dgfemi_arena *arena, const dgfem_matrix *matrix, dgfemi_graph *graph) {
    int n = matrix->block_count, r, k;
    size_t edges = 2 * (size_t)(matrix->row_start[n] - n);
    graph->count = n;
    graph->start = (int *)dgfemi_arena_allocate_zero(arena, (size_t)n + 1, sizeof(int));
    graph->neighbour = (int *)dgfemi_arena_allocate(arena, edges, sizeof(int));
    graph->block = (int *)dgfemi_arena_allocate(arena, edges, sizeof(int));
    graph->weight = (int *)dgfemi_arena_allocate(arena, (size_t)n, sizeof(int));
    if (!graph->start || !graph->neighbour || !graph->block || !graph->weight) return 0;
    for (r = 0; r < n; r++) {
        graph->weight[r] = dgfemi_block_size(matrix, r);
        for (k = matrix->row_start[r]; k < dgfemi_diagonal_index(matrix, r); k++)
            graph->start[r]++, graph->start[matrix->column[k]]++;
    }
    dgfemi_counts_to_starts(graph->start, n);
    for (r = 0; r < n; r++)
        for (k = matrix->row_start[r]; k < dgfemi_diagonal_index(matrix, r); k++) {
            int c = matrix->column[k], at_r = graph->start[r]++, at_c = graph->start[c]++;
            graph->neighbour[at_r] = c, graph->block[at_r] = k;
            graph->neighbour[at_c] = r, graph->block[at_c] = k;
        }
    dgfemi_restore_starts(graph->start, n);
    return 1;
}

/* ---- minimum degree ---- */

/* Approximate minimum degree (Amestoy, Davis, Duff 1996) on the quotient graph. A node is a variable, not yet
   eliminated; or an element, the clique of variables that an elimination left; or dead: a variable merged into an
   indistinguishable one, an element swallowed by a later one.

   list of a variable:  its elements, then the variables that it still neighbours directly
   list of an element:  its variables */
typedef struct dgfemi_quotient {
    int count;
    const unsigned char *frozen; /* variables that count in degrees but are never eliminated; or NULL */
    int *list, *spare;           /* all lists; and as much room to pack them into */
    int used, room;              /* of list */
    int *start, *length;         /* [count] a node's list; length is DGFEM_NONE when dead */
    int *elements;               /* [count] variable: elements in its list */
    int *weight;                 /* [count] variable: of it and all that are merged into it; 0 otherwise */
    int *degree;                 /* [count] variable: bound of its neighbours' weight; element: its variables' weight */
    int64_t *mark;               /* [count] variable: == stamp when in the new element; element: see count_outside */
    int64_t stamp, stamp_step;
    int *head, *next, *previous; /* variables by degree; next also chains those of equal hash */
    int lowest;                  /* no variable has a lower degree */
    int *hash, *bucket;          /* [count] variable: hash of its list; first variable of each hash */
    int *member, *last_member;   /* [count] chain of the variables merged into one */
    int remaining;               /* weight of all variables */
    int *order, ordered;         /* the result */
} dgfemi_quotient;

static int dgfemi_quotient_allocate(dgfemi_quotient *q, dgfemi_arena *arena, const dgfemi_graph *graph) {
    int **arrays[11];
    size_t n = (size_t)graph->count;
    int edges = graph->start[graph->count], i;
    q->count = graph->count;
    q->room = edges + edges / 4 + graph->count;
    arrays[0] = &q->start, arrays[1] = &q->length, arrays[2] = &q->elements, arrays[3] = &q->weight;
    arrays[4] = &q->degree, arrays[5] = &q->next, arrays[6] = &q->previous, arrays[7] = &q->hash;
    arrays[8] = &q->bucket, arrays[9] = &q->member, arrays[10] = &q->last_member;
    for (i = 0; i < 11; i++) {
        *arrays[i] = (int *)dgfemi_arena_allocate_zero(arena, n, sizeof(int));
        if (!*arrays[i]) return 0;
    }
    q->list = (int *)dgfemi_arena_allocate(arena, (size_t)q->room, sizeof(int));
    q->spare = (int *)dgfemi_arena_allocate(arena, (size_t)q->room, sizeof(int));
    q->mark = (int64_t *)dgfemi_arena_allocate_zero(arena, n, sizeof(int64_t));
    return q->list && q->spare && q->mark;
}

static int dgfemi_is_frozen(const dgfemi_quotient *q, int i) { return q->frozen && q->frozen[i]; }

static void dgfemi_degree_insert(dgfemi_quotient *q, int i) {
    int first;
    if (dgfemi_is_frozen(q, i)) return;
    first = q->head[q->degree[i]];
    q->next[i] = first;
    q->previous[i] = DGFEM_NONE;
    if (first != DGFEM_NONE) q->previous[first] = i;
    q->head[q->degree[i]] = i;
    if (q->degree[i] < q->lowest) q->lowest = q->degree[i];
}

static void dgfemi_degree_remove(dgfemi_quotient *q, int i) {
    if (dgfemi_is_frozen(q, i)) return;
    if (q->previous[i] != DGFEM_NONE) q->next[q->previous[i]] = q->next[i];
    else q->head[q->degree[i]] = q->next[i];
    if (q->next[i] != DGFEM_NONE) q->previous[q->next[i]] = q->previous[i];
}

/* Divides the weights by their greatest common divisor: blocks of one size count as 1. Returns the total. */
static int dgfemi_quotient_weights(const dgfemi_graph *graph, int *weight) {
    int divisor = 0, total = 0, i;
    for (i = 0; i < graph->count; i++) {
        int a = graph->weight[i];
        while (a) {
            int rest = divisor % a;
            divisor = a;
            a = rest;
        }
    }
    for (i = 0; i < graph->count; i++) total += weight[i] = graph->weight[i] / divisor;
    return total;
}

/* A variable coupled to very many others would be scanned at each of their eliminations, and would fill in any order:
   it goes last and leaves the graph. */
static int dgfemi_is_dense(const dgfemi_graph *graph, int i) {
    double degree = graph->start[i + 1] - graph->start[i];
    return degree > 16 && degree > 10 * sqrt((double)graph->count);
}

static void dgfemi_quotient_fill(dgfemi_quotient *q, const dgfemi_graph *graph, int total) {
    int i, k;
    q->stamp = 1;
    q->stamp_step = (int64_t)total + 1;
    q->lowest = total;
    for (i = 0; i <= total; i++) q->head[i] = DGFEM_NONE;
    for (i = 0; i < q->count; i++) {
        q->bucket[i] = q->member[i] = DGFEM_NONE;
        q->last_member[i] = i;
        if (dgfemi_is_dense(graph, i)) q->weight[i] = 0;
        q->remaining += q->weight[i];
    }
    for (i = 0; i < q->count; i++) {
        q->start[i] = q->used;
        if (!q->weight[i]) {
            q->length[i] = DGFEM_NONE;
            continue;
        }
        for (k = graph->start[i]; k < graph->start[i + 1]; k++) {
            int j = graph->neighbour[k];
            if (!q->weight[j]) continue;
            q->list[q->used++] = j;
            q->degree[i] += q->weight[j];
        }
        q->length[i] = q->used - q->start[i];
    }
    for (i = q->count - 1; i >= 0; i--) /* equal degrees leave in ascending order */
        if (q->weight[i]) dgfemi_degree_insert(q, i);
}

/* Makes room for a list of all nodes at the end. */
static void dgfemi_quotient_pack(dgfemi_quotient *q) {
    int *packed = q->spare, used = 0, i, k;
    if (q->room - q->used >= q->count) return;
    for (i = 0; i < q->count; i++) {
        int start = q->start[i];
        q->start[i] = used;
        for (k = 0; k < q->length[i]; k++) packed[used++] = q->list[start + k];
    }
    q->spare = q->list;
    q->list = packed;
    q->used = used;
}

/* Puts a variable, and all merged into it, into the order. */
static void dgfemi_quotient_order(dgfemi_quotient *q, int i) {
    q->remaining -= q->weight[i];
    q->weight[i] = 0;
    for (; i != DGFEM_NONE; i = q->member[i]) q->order[q->ordered++] = i;
}

/* Lp = (variables next to p, directly or in one of its elements) \ p. The elements are swallowed. */
static void dgfemi_quotient_eliminate(dgfemi_quotient *q, int p) {
    int first = q->used, weight = 0, k, m;
    q->stamp += q->stamp_step;
    q->mark[p] = q->stamp;
    for (k = 0; k <= q->elements[p]; k++) {
        int whole = k < q->elements[p]; /* at last, the direct neighbours */
        int e = whole ? q->list[q->start[p] + k] : p;
        int from = whole ? q->start[e] : q->start[p] + q->elements[p];
        int length = whole ? q->length[e] : q->length[p] - q->elements[p];
        for (m = 0; m < length; m++) {
            int i = q->list[from + m];
            if (!q->weight[i] || q->mark[i] == q->stamp) continue;
            q->mark[i] = q->stamp;
            q->list[q->used++] = i;
            weight += q->weight[i];
            dgfemi_degree_remove(q, i);
        }
        q->length[e] = DGFEM_NONE;
    }
    dgfemi_quotient_order(q, p);
    q->start[p] = first;
    q->length[p] = q->used - first;
    q->degree[p] = weight;
    q->mark[p] = 0;
}

/* Afterwards mark[e] - stamp is the weight of Le \ Lp for each element e that shares a variable with Lp. */
static void dgfemi_quotient_count_outside(dgfemi_quotient *q, int p) {
    int m, k;
    for (m = 0; m < q->length[p]; m++) {
        int i = q->list[q->start[p] + m];
        for (k = 0; k < q->elements[i]; k++) {
            int e = q->list[q->start[i] + k];
            if (q->length[e] == DGFEM_NONE) continue;
            if (q->mark[e] < q->stamp) q->mark[e] = q->stamp + q->degree[e];
            q->mark[e] -= q->weight[i];
        }
    }
}

/* Rewrites the list of i, a variable of Lp: p first, then the elements that reach beyond Lp (the others are swallowed),
   then the variables outside Lp. Returns the weight of what i has beyond Lp, counted once per element. */
static int dgfemi_quotient_rewrite(dgfemi_quotient *q, int p, int i) {
    int *list = q->list + q->start[i];
    int length = q->length[i], elements = q->elements[i], kept = 0, k;
    unsigned hash = (unsigned)p;
    int64_t beyond = 0;
    for (k = 0; k < elements; k++) {
        int e = list[k];
        if (q->length[e] == DGFEM_NONE) continue;
        if (q->mark[e] == q->stamp) {
            q->length[e] = DGFEM_NONE;
            continue;
        }
        beyond += q->mark[e] - q->stamp;
        hash += (unsigned)e;
        list[kept++] = e;
    }
    q->elements[i] = kept + 1;
    for (k = elements; k < length; k++) {
        int j = list[k];
        if (!q->weight[j] || q->mark[j] == q->stamp) continue;
        beyond += q->weight[j];
        hash += (unsigned)j;
        list[kept++] = j;
    }
    /* p was the way into Lp, itself or through an element now swallowed: at least one place has become free */
    list[kept] = list[q->elements[i] - 1];
    list[q->elements[i] - 1] = list[0];
    list[0] = p;
    q->length[i] = kept + 1;
    q->hash[i] = (int)(hash % (unsigned)q->count);
    return beyond < q->remaining ? (int)beyond : q->remaining;
}

/* Same elements and same neighbours? Those of i carry the stamp. */
static int dgfemi_quotient_same(const dgfemi_quotient *q, int i, int j) {
    int k;
    if (q->length[i] != q->length[j] || q->elements[i] != q->elements[j]) return 0;
    for (k = 0; k < q->length[j]; k++)
        if (q->mark[q->list[q->start[j] + k]] != q->stamp) return 0;
    return 1;
}

/* Merges variables of Lp that have become indistinguishable: they would be eliminated one after another. */
static void dgfemi_quotient_merge(dgfemi_quotient *q, int first) {
    int i, k;
    for (i = first; i != DGFEM_NONE; i = q->next[i]) {
        int before = i, j = q->next[i];
        if (j == DGFEM_NONE) return;
        q->stamp++;
        for (k = 0; k < q->length[i]; k++) q->mark[q->list[q->start[i] + k]] = q->stamp;
        for (; j != DGFEM_NONE; j = q->next[j]) {
            if (!dgfemi_quotient_same(q, i, j)) {
                before = j;
                continue;
            }
            q->weight[i] += q->weight[j];
            q->weight[j] = 0;
            q->length[j] = DGFEM_NONE;
            q->member[q->last_member[i]] = j;
            q->last_member[i] = q->last_member[j];
            q->next[before] = q->next[j];
        }
    }
}

/* New lists and degrees for the variables of the new element p; some are eliminated with it, some merge. */
static void dgfemi_quotient_update(dgfemi_quotient *q, int p) {
    int *variables = q->list + q->start[p];
    int count = q->length[p], kept = 0, m;
    dgfemi_quotient_count_outside(q, p);
    for (m = 0; m < count; m++) {
        int i = variables[m], beyond = dgfemi_quotient_rewrite(q, p, i);
        if (dgfemi_is_frozen(q, i)) continue;
        if (beyond == 0) { /* nothing but Lp: eliminated now, it adds no fill */
            q->degree[p] -= q->weight[i];
            q->length[i] = DGFEM_NONE;
            dgfemi_quotient_order(q, i);
            continue;
        }
        if (beyond < q->degree[i]) q->degree[i] = beyond; /* for now without Lp */
        q->next[i] = q->bucket[q->hash[i]];
        q->bucket[q->hash[i]] = i;
    }
    q->stamp += q->stamp_step; /* above the marks of elements, which merging must not mistake for its own */
    for (m = 0; m < count; m++) {
        int i = variables[m], first;
        if (!q->weight[i] || dgfemi_is_frozen(q, i)) continue;
        first = q->bucket[q->hash[i]];
        q->bucket[q->hash[i]] = DGFEM_NONE;
        dgfemi_quotient_merge(q, first);
    }
    for (m = 0; m < count; m++) {
        int i = variables[m], others = q->degree[p] - q->weight[i], bound = q->remaining - q->weight[i];
        if (!q->weight[i]) continue;
        variables[kept++] = i;
        if (dgfemi_is_frozen(q, i)) continue;
        q->degree[i] = q->degree[i] < bound - others ? q->degree[i] + others : bound;
        dgfemi_degree_insert(q, i);
    }
    q->length[p] = kept;
    q->used = q->start[p] + kept;
}

/* Writes the vertices that are not frozen (frozen NULL: all) into order, from the front. Returns their number, or
   DGFEM_NONE when out of memory. */
static int dgfemi_minimum_degree(dgfemi_arena *arena, const dgfemi_graph *graph, const unsigned char *frozen,
                                 int *order) {
    dgfemi_quotient quotient, *q = &quotient;
    int total, i;
    memset(q, 0, sizeof *q);
    q->frozen = frozen;
    q->order = order;
    if (!dgfemi_quotient_allocate(q, arena, graph)) return DGFEM_NONE;
    total = dgfemi_quotient_weights(graph, q->weight);
    q->head = (int *)dgfemi_arena_allocate(arena, (size_t)total + 1, sizeof(int));
    if (!q->head) return DGFEM_NONE;
    dgfemi_quotient_fill(q, graph, total);
    for (;;) {
        int p;
        while (q->lowest < total && q->head[q->lowest] == DGFEM_NONE) q->lowest++;
        p = q->head[q->lowest];
        if (p == DGFEM_NONE) break;
        dgfemi_degree_remove(q, p);
        dgfemi_quotient_pack(q);
        dgfemi_quotient_eliminate(q, p);
        dgfemi_quotient_update(q, p);
    }
    for (i = 0; i < graph->count; i++)
        if (dgfemi_is_dense(graph, i) && !dgfemi_is_frozen(q, i)) order[q->ordered++] = i;
    return q->ordered;
}

/* ---- geometric nested dissection ---- */

/* Normals of the planes to try. Where cells touch their neighbours only across faces, as in a grid, a diagonal plane
   cuts fewer cells than one along the grid. */
#define DGFEM_DIRECTIONS 13

static dgfem_vec3 dgfemi_direction(int i) {
    static const signed char table[DGFEM_DIRECTIONS][3] = {{1, 0, 0},  {0, 1, 0},  {0, 0, 1},  {1, 1, 0},  {1, -1, 0},
                                                           {1, 0, 1},  {1, 0, -1}, {0, 1, 1},  {0, 1, -1}, {1, 1, 1},
                                                           {1, 1, -1}, {1, -1, 1}, {1, -1, -1}};
    return dgfemi_vec3((dgfem_real)table[i][0], (dgfem_real)table[i][1], (dgfem_real)table[i][2]);
}

enum {
    DGFEM_LARGE_PARTS = 8,    /* parts of this fraction of the graph or more, where separators are long */
    DGFEM_TRIALS = 4,         /* there: cuts along different directions that are narrowed, to take the best */
    DGFEM_PROMISING = 7,      /* in smaller parts: directions to try, those that were best in the large ones */
    DGFEM_SMALLEST_PART = 48, /* vertices; smaller parts are left to minimum degree */
    DGFEM_KEY_BITS = 10       /* places along a direction are rounded to twice as many bits: ties survive round-off */
};

typedef enum dgfemi_side { DGFEM_SIDE_AHEAD, DGFEM_SIDE_PASSED, DGFEM_SIDE_SEPARATOR } dgfemi_side;

typedef struct dgfemi_dissection {
    const dgfemi_graph *graph;
    int *sorted[DGFEM_DIRECTIONS]; /* vertices by place along each direction; a part is the same range of each list */
    int *part;                     /* [count] of each vertex; DGFEM_NONE in a separator */
    int parts;                     /* made so far */
    int *scratch;                  /* [count] */
    double rating[DGFEM_DIRECTIONS]; /* the less the better: costs over the least ones, summed over the large parts */
    /* the part that is being dissected: its vertices are numbered by their places in sorted[0] */
    int *number;         /* [count] of each vertex of the graph */
    dgfemi_graph local;  /* without block */
    int *rank;           /* place along a direction */
    int *change[3];      /* [count + 2] of the weights passed, in the last layer, in the next layer */
    unsigned char *side; /* a dgfemi_side */
    unsigned char *best_side;
    /* the network of dgfemi_narrow_separator */
    int *band, band_count;   /* its vertices */
    int *level;              /* distance from the separator; DGFEM_NONE outside the band */
    unsigned char *touches;  /* bit 0: the part passed, bit 1: the part ahead, both without the band */
    int *before, *after;     /* neighbours on the path through a vertex, or one of the following */
    int *next;               /* the neighbour to look at next */
    int *stack, *list;       /* [2 * count] states to go on from, by depth or by breadth */
    int *from;               /* [2 * count] the state that each was reached from */
    int *distance;           /* [2 * count] steps from the part passed; DGFEM_NONE: not to be reached */
    unsigned char *old_side;
} dgfemi_dissection;

/* A sweep along a direction that stops after `passed` vertices. The separator is the layer of vertices with a neighbour
   across: the last one passed or the first one ahead. */
typedef struct dgfemi_cut {
    double cost;
    int direction, passed;
    int ahead; /* 1: the separator is the layer ahead */
} dgfemi_cut;

#define DGFEM_NO_CUT 1e300
#define DGFEM_HOPELESS 1.2  /* a cut that costs so much more than the best is not narrowed */
#define DGFEM_WORTH_IT 0.97 /* a later trial must be so much cheaper: the first cut suits the grid, if there is one */

/* Weights of the separator and of what lies to its sides. The ratio cut weighs a small separator against even halves;
   the 1 lets even halves win where nothing need be cut. */
static double dgfemi_cut_cost(double separator, double passed, double ahead) {
    double smaller = passed < ahead ? passed : ahead;
    if (16 * smaller < separator + passed + ahead) return DGFEM_NO_CUT; /* or the parts would be too many */
    return (separator + 1) / (passed * ahead);
}

/* Stable sort by one digit of the keys. */
static void dgfemi_sort_by_digit(const int *key, int shift, const int *from, int *to, int count) {
    int starts[(1 << DGFEM_KEY_BITS) + 1], mask = (1 << DGFEM_KEY_BITS) - 1, i;
    memset(starts, 0, sizeof starts);
    for (i = 0; i < count; i++) starts[(key[from[i]] >> shift) & mask]++;
    dgfemi_counts_to_starts(starts, 1 << DGFEM_KEY_BITS);
    for (i = 0; i < count; i++) to[starts[(key[from[i]] >> shift) & mask]++] = from[i];
}

/* Lists the vertices by their place along a direction, ties by index. */
static void dgfemi_sort_along(dgfemi_dissection *d, const dgfem_vec3 *points, dgfem_vec3 direction, int *sorted) {
    int n = d->graph->count, *key = d->rank, i;
    dgfem_real low = dgfemi_dot(direction, points[0]), high = low, scale;
    for (i = 1; i < n; i++) {
        dgfem_real place = dgfemi_dot(direction, points[i]);
        low = dgfemi_min(low, place);
        high = dgfemi_max(high, place);
    }
    scale = high > low ? (dgfem_real)((1 << 2 * DGFEM_KEY_BITS) - 2) / (high - low) : 0;
    for (i = 0; i < n; i++) {
        key[i] = (int)((dgfemi_dot(direction, points[i]) - low) * scale + DGFEM_R(0.5));
        sorted[i] = i;
    }
    dgfemi_sort_by_digit(key, 0, sorted, d->scratch, n);
    dgfemi_sort_by_digit(key, DGFEM_KEY_BITS, d->scratch, sorted, n);
}

/* Moves one coordinate of the points to 0..1, halving first so that nothing overflows; then makes the typical distance
   of neighbours its unit, so that diagonal planes are diagonal to the cells also where these are flat. */
static void dgfemi_normalise_axis(const dgfemi_graph *graph, dgfem_real *x) {
    enum { STRIDE = 3 };
    dgfem_real low = x[0] / 2, high = low;
    double sum = 0, squares = 0;
    int v, k;
    for (v = 0; v < graph->count; v++) {
        low = dgfemi_min(low, x[v * STRIDE] / 2);
        high = dgfemi_max(high, x[v * STRIDE] / 2);
    }
    for (v = 0; v < graph->count; v++) x[v * STRIDE] = high > low ? (x[v * STRIDE] / 2 - low) / (high - low) : 0;
    for (v = 0; v < graph->count; v++)
        for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
            double distance = fabs((double)x[v * STRIDE] - (double)x[graph->neighbour[k] * STRIDE]);
            sum += distance;
            squares += distance * distance;
        }
    if (!(squares > 1e-9 * sum)) return;
    for (v = 0; v < graph->count; v++) x[v * STRIDE] *= (dgfem_real)(sum / squares);
}

/* ---- cutting by a sweep ---- */

/* Numbers the vertices of a part and gathers its edges. Returns its weight, 0 when it has no edges. */
static double dgfemi_make_local(dgfemi_dissection *d, int first, int last) {
    const dgfemi_graph *graph = d->graph;
    const int *vertices = d->sorted[0] + first;
    dgfemi_graph *local = &d->local;
    int edges = 0, i, k;
    double total = 0;
    local->count = last - first;
    for (i = 0; i < local->count; i++) d->number[vertices[i]] = i;
    for (i = 0; i < local->count; i++) {
        int v = vertices[i];
        local->start[i] = edges;
        local->weight[i] = graph->weight[v];
        total += graph->weight[v];
        for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
            int u = graph->neighbour[k];
            if (d->part[u] == d->part[v]) local->neighbour[edges++] = d->number[u];
        }
    }
    local->start[local->count] = edges;
    return edges ? total : 0;
}

/* A sweep stops after some vertices; those with lower ranks are passed then. v is in the last layer (passed, with a
   neighbour ahead) from when it is passed until its last neighbour is, and in the next layer (ahead, with a passed
   neighbour) from when its first neighbour is passed until itself is. */
static void dgfemi_sweep_changes(dgfemi_dissection *d) {
    const dgfemi_graph *local = &d->local;
    int *passed = d->change[0], *last_layer = d->change[1], *next_layer = d->change[2], v, k;
    for (k = 0; k < 3; k++) memset(d->change[k], 0, ((size_t)local->count + 2) * sizeof(int));
    for (v = 0; v < local->count; v++) {
        int rank = d->rank[v], low = rank, high = rank, weight = local->weight[v];
        for (k = local->start[v]; k < local->start[v + 1]; k++) {
            int other = d->rank[local->neighbour[k]];
            low = other < low ? other : low;
            high = other > high ? other : high;
        }
        passed[rank + 1] += weight;
        last_layer[rank + 1] += weight;
        last_layer[high + 1] -= weight;
        next_layer[low + 1] += weight;
        next_layer[rank + 1] -= weight;
    }
}

/* Improves *best by the places where a sweep along one direction may stop. The separator is one of the two layers. */
static void dgfemi_sweep(dgfemi_dissection *d, int direction, int first, double total, dgfemi_cut *best) {
    const int *sorted = d->sorted[direction] + first;
    double weight[3] = {0, 0, 0};
    int at, i;
    for (at = 0; at < d->local.count; at++) d->rank[d->number[sorted[at]]] = at;
    dgfemi_sweep_changes(d);
    for (at = 1; at <= d->local.count; at++) {
        for (i = 0; i < 3; i++) weight[i] += d->change[i][at];
        for (i = 0; i < 2; i++) {
            double separator = weight[1 + i], before = i == 0 ? weight[0] - separator : weight[0];
            double after = total - separator - before, cost;
            /* what is no better needs no exact cost; equal ones must not win by round-off */
            if (separator + 1 >= best->cost * (1 - 1e-12) * before * after) continue;
            cost = dgfemi_cut_cost(separator, before, after);
            if (!(cost < best->cost)) continue;
            best->cost = cost;
            best->direction = direction;
            best->passed = at;
            best->ahead = i;
        }
    }
}

/* Sets the side of every vertex of the part. */
static void dgfemi_apply_cut(dgfemi_dissection *d, int first, const dgfemi_cut *cut) {
    const dgfemi_graph *local = &d->local;
    const int *sorted = d->sorted[cut->direction] + first;
    int own = cut->ahead ? DGFEM_SIDE_AHEAD : DGFEM_SIDE_PASSED;
    int other = cut->ahead ? DGFEM_SIDE_PASSED : DGFEM_SIDE_AHEAD;
    int at, v, k;
    for (at = 0; at < local->count; at++)
        d->side[d->number[sorted[at]]] = at < cut->passed ? DGFEM_SIDE_PASSED : DGFEM_SIDE_AHEAD;
    for (v = 0; v < local->count; v++)
        for (k = local->start[v]; k < local->start[v + 1] && d->side[v] == own; k++)
            if (d->side[local->neighbour[k]] == other) d->side[v] = DGFEM_SIDE_SEPARATOR;
}

/* ---- narrowing a separator ----

   A plane cuts an irregular mesh along a rough layer. Between what is left of the two sides without a band around
   that layer,

       passed | band   separator   band | ahead
              |  ---------->  path      |

   the smallest separator has as many vertices as there are disjoint paths (Menger), and stands where a search for one
   more path gets stuck. Each vertex is an arc of capacity one from its entry 2v to its exit 2v + 1. */

enum { DGFEM_PATH_ENDS = -2 }; /* in before[] and after[]: the path comes from, or goes to, the side */

/* All vertices of the part within `depth` edges of the separator. */
static void dgfemi_collect_band(dgfemi_dissection *d, int depth) {
    const dgfemi_graph *local = &d->local;
    int at, v, k;
    d->band_count = 0;
    for (v = 0; v < local->count; v++) {
        d->level[v] = DGFEM_NONE;
        if (d->side[v] != DGFEM_SIDE_SEPARATOR) continue;
        d->level[v] = 0;
        d->band[d->band_count++] = v;
    }
    for (at = 0; at < d->band_count; at++) {
        v = d->band[at];
        d->touches[v] = 0;
        d->before[v] = d->after[v] = DGFEM_NONE;
        d->old_side[v] = d->side[v];
        for (k = local->start[v]; k < local->start[v + 1]; k++) {
            int u = local->neighbour[k];
            if (d->level[u] != DGFEM_NONE) continue;
            if (d->level[v] == depth) {
                d->touches[v] |= d->side[u] == DGFEM_SIDE_PASSED ? 1 : 2;
                continue;
            }
            d->level[u] = d->level[v] + 1;
            d->band[d->band_count++] = u;
        }
    }
}

/* 1 where a search begins: a path may come in from the part passed, and none does. */
static int dgfemi_is_source(const dgfemi_dissection *d, int v) {
    return (d->touches[v] & 1) && d->before[v] != DGFEM_PATH_ENDS;
}

static void dgfemi_reach(dgfemi_dissection *d, int state, int distance, int *listed) {
    if (d->distance[state] != DGFEM_NONE) return;
    d->distance[state] = distance;
    d->list[(*listed)++] = state;
}

/* Distances from the part passed of all states, as the paths allow steps, up to the nearest one that the band can be
   left from. Returns its distance, or DGFEM_NONE where no path can be added. */
static int dgfemi_measure_band(dgfemi_dissection *d) {
    const dgfemi_graph *local = &d->local;
    int listed = 0, at, k;
    for (at = 0; at < d->band_count; at++) {
        int v = d->band[at];
        d->distance[2 * v] = d->distance[2 * v + 1] = DGFEM_NONE;
        d->next[v] = local->start[v];
        if (dgfemi_is_source(d, v)) dgfemi_reach(d, 2 * v, 0, &listed);
    }
    for (at = 0; at < listed; at++) {
        int state = d->list[at], v = state / 2, taken = d->after[v] != DGFEM_NONE, distance = d->distance[state] + 1;
        if (state % 2 == 0) {
            if (!taken) dgfemi_reach(d, state + 1, distance, &listed);
            else if (d->before[v] >= 0) dgfemi_reach(d, 2 * d->before[v] + 1, distance, &listed);
            continue;
        }
        if (d->touches[v] & 2) return d->distance[state];
        if (taken) dgfemi_reach(d, state - 1, distance, &listed);
        for (k = local->start[v]; k < local->start[v + 1]; k++) {
            int u = local->neighbour[k];
            if (d->level[u] != DGFEM_NONE) dgfemi_reach(d, 2 * u, distance, &listed);
        }
    }
    return DGFEM_NONE;
}

/* The next state that a search goes on to from this one: one step farther, not visited since the distances were
   measured. DGFEM_NONE where there is none. */
static int dgfemi_step_on(dgfemi_dissection *d, int state) {
    const dgfemi_graph *local = &d->local;
    int v = state / 2, taken = d->after[v] != DGFEM_NONE, distance = -2 - d->distance[state] + 1;
    if (state % 2 == 0) {
        int only = !taken ? state + 1 : d->before[v] >= 0 ? 2 * d->before[v] + 1 : DGFEM_NONE;
        return only != DGFEM_NONE && d->distance[only] == distance ? only : DGFEM_NONE;
    }
    if (taken && d->distance[state - 1] == distance) return state - 1;
    while (d->next[v] < local->start[v + 1]) {
        int u = local->neighbour[d->next[v]++];
        if (d->level[u] != DGFEM_NONE && d->distance[2 * u] == distance) return 2 * u;
    }
    return DGFEM_NONE;
}

/* A path from a vertex that touches the part passed, by steps that lead away from there; it may push other paths
   aside. Returns the exit that it leaves the band by, at distance `end`, or DGFEM_NONE. No state is on two paths, so
   what has been visited is no way for later searches: its distance d becomes -2 - d. */
static int dgfemi_find_path(dgfemi_dissection *d, int source, int end) {
    int stacked = 0, state = 2 * source, from = DGFEM_NONE;
    if (d->distance[state] != 0) return DGFEM_NONE;
    for (;;) {
        if (state != DGFEM_NONE) {
            int distance = d->distance[state];
            d->from[state] = from;
            d->distance[state] = -2 - distance;
            if (state % 2 == 1 && distance == end && (d->touches[state / 2] & 2)) return state;
            d->stack[stacked++] = state;
        } else if (--stacked == 0) {
            return DGFEM_NONE;
        }
        from = d->stack[stacked - 1];
        state = dgfemi_step_on(d, from);
    }
}

/* Takes the path found into the set: first unlinks the steps that it goes against, then links its own. */
static void dgfemi_take_path(dgfemi_dissection *d, int last) {
    int state, previous;
    for (state = last; (previous = d->from[state]) != DGFEM_NONE; state = previous)
        if (previous % 2 == 0 && state / 2 != previous / 2) d->after[state / 2] = d->before[previous / 2] = DGFEM_NONE;
    for (state = last; (previous = d->from[state]) != DGFEM_NONE; state = previous)
        if (previous % 2 == 1 && state / 2 != previous / 2) {
            d->after[previous / 2] = state / 2;
            d->before[state / 2] = previous / 2;
        }
    d->before[state / 2] = DGFEM_PATH_ENDS;
    d->after[last / 2] = DGFEM_PATH_ENDS;
}

/* Replaces the separator by the smallest one within the band if that costs less; 1 if so. Vertices count as one each
   here, by their weights in the cost. */
static int dgfemi_narrow_separator(dgfemi_dissection *d, int depth, double *cost) {
    double weight[3] = {0, 0, 0}, new_cost;
    int i, end;
    dgfemi_collect_band(d, depth);
    while ((end = dgfemi_measure_band(d)) != DGFEM_NONE)
        for (i = 0; i < d->band_count; i++) {
            int source = d->band[i], path = DGFEM_NONE;
            if (dgfemi_is_source(d, source)) path = dgfemi_find_path(d, source, end);
            if (path != DGFEM_NONE) dgfemi_take_path(d, path);
        }
    for (i = 0; i < d->band_count; i++) {
        int v = d->band[i];
        d->side[v] = DGFEM_SIDE_AHEAD;
        if (d->distance[2 * v] != DGFEM_NONE || (d->touches[v] & 1))
            d->side[v] = d->distance[2 * v + 1] != DGFEM_NONE ? DGFEM_SIDE_PASSED : DGFEM_SIDE_SEPARATOR;
    }
    for (i = 0; i < d->local.count; i++) weight[d->side[i]] += d->local.weight[i];
    new_cost = dgfemi_cut_cost(weight[DGFEM_SIDE_SEPARATOR], weight[DGFEM_SIDE_PASSED], weight[DGFEM_SIDE_AHEAD]);
    if (new_cost < *cost) {
        *cost = new_cost;
        return 1;
    }
    for (i = 0; i < d->band_count; i++) d->side[d->band[i]] = d->old_side[d->band[i]];
    return 0;
}

/* ---- the recursion ---- */

static int dgfemi_dissection_allocate(dgfemi_dissection *d, dgfemi_arena *arena) {
    int **arrays[DGFEM_DIRECTIONS + 20];
    size_t n = (size_t)d->graph->count;
    int count = 0, i;
    for (i = 0; i < DGFEM_DIRECTIONS; i++) arrays[count++] = &d->sorted[i];
    for (i = 0; i < 3; i++) arrays[count++] = &d->change[i];
    arrays[count++] = &d->part, arrays[count++] = &d->number, arrays[count++] = &d->rank;
    arrays[count++] = &d->local.start, arrays[count++] = &d->local.weight;
    arrays[count++] = &d->scratch, arrays[count++] = &d->band, arrays[count++] = &d->level;
    arrays[count++] = &d->before, arrays[count++] = &d->after, arrays[count++] = &d->next;
    arrays[count++] = &d->stack, arrays[count++] = &d->list, arrays[count++] = &d->from; /* these are twice as long */
    arrays[count++] = &d->distance;
    for (i = 0; i < count; i++) {
        *arrays[i] = (int *)dgfemi_arena_allocate(arena, i < count - 4 ? n + 2 : 2 * n, sizeof(int));
        if (!*arrays[i]) return 0;
    }
    memset(d->part, 0, n * sizeof(int));
    d->local.neighbour = (int *)dgfemi_arena_allocate(arena, (size_t)d->graph->start[n], sizeof(int));
    d->side = (unsigned char *)dgfemi_arena_allocate(arena, n, 1);
    d->best_side = (unsigned char *)dgfemi_arena_allocate(arena, n, 1);
    d->old_side = (unsigned char *)dgfemi_arena_allocate(arena, n, 1);
    d->touches = (unsigned char *)dgfemi_arena_allocate(arena, n, 1);
    return d->local.neighbour && d->side && d->best_side && d->old_side && d->touches;
}

/* Lists the vertices along all directions. 0 when out of memory. */
static int dgfemi_dissection_sort(dgfemi_dissection *d, dgfemi_arena *arena, const dgfem_vec3 *centres) {
    size_t bytes = (size_t)d->graph->count * sizeof(dgfem_vec3);
    dgfem_vec3 *points = (dgfem_vec3 *)dgfemi_arena_allocate(arena, bytes, 1);
    int i;
    if (!points) return 0;
    memcpy(points, centres, bytes);
    dgfemi_normalise_axis(d->graph, &points->x);
    dgfemi_normalise_axis(d->graph, &points->y);
    dgfemi_normalise_axis(d->graph, &points->z);
    for (i = 0; i < DGFEM_DIRECTIONS; i++) dgfemi_sort_along(d, points, dgfemi_direction(i), d->sorted[i]);
    return 1;
}

/* Sorts the range of a list by side, otherwise in its order. */
static void dgfemi_split_list(dgfemi_dissection *d, int *list, int count, const int sizes[3]) {
    int place[3], i;
    place[0] = 0, place[1] = sizes[0], place[2] = sizes[0] + sizes[1];
    for (i = 0; i < count; i++) d->scratch[place[d->side[d->number[list[i]]]]++] = list[i];
    memcpy(list, d->scratch, (size_t)count * sizeof *list);
}

/* The best cut along each direction, or along the most promising ones only. */
static void dgfemi_find_cuts(dgfemi_dissection *d, int first, double total, int promising, dgfemi_cut *cuts) {
    int i, k;
    for (i = 0; i < DGFEM_DIRECTIONS; i++) {
        int better = 0;
        for (k = 0; k < DGFEM_DIRECTIONS; k++)
            better += d->rating[k] < d->rating[i] || (d->rating[k] == d->rating[i] && k < i);
        cuts[i].cost = DGFEM_NO_CUT;
        if (!promising || better < DGFEM_PROMISING) dgfemi_sweep(d, i, first, total, &cuts[i]);
    }
}

static void dgfemi_rate_directions(dgfemi_dissection *d, const dgfemi_cut *cuts) {
    const double bad = 3; /* as bad as need be */
    double best = DGFEM_NO_CUT;
    int i;
    for (i = 0; i < DGFEM_DIRECTIONS; i++)
        if (cuts[i].cost < best) best = cuts[i].cost;
    for (i = 0; i < DGFEM_DIRECTIONS; i++) d->rating[i] += cuts[i].cost < bad * best ? cuts[i].cost / best : bad;
}

/* Sets the sides by the cheapest separator found: the best cuts of several directions, each narrowed. Returns its cost,
   or DGFEM_NO_CUT. */
static double dgfemi_find_separator(dgfemi_dissection *d, int first, double total) {
    dgfemi_cut cuts[DGFEM_DIRECTIONS];
    double best_cost = DGFEM_NO_CUT;
    int large = d->local.count >= d->graph->count / DGFEM_LARGE_PARTS, trials = large ? DGFEM_TRIALS : 1, trial, i;
    dgfemi_find_cuts(d, first, total, !large, cuts);
    if (large) dgfemi_rate_directions(d, cuts);
    for (trial = 0; trial < trials; trial++) {
        dgfemi_cut *best = &cuts[0];
        double cost;
        for (i = 1; i < DGFEM_DIRECTIONS; i++)
            if (cuts[i].cost < best->cost * (1 - 1e-12)) best = &cuts[i];
        cost = best->cost;
        if (!(cost < DGFEM_NO_CUT) || cost > best_cost * DGFEM_HOPELESS) break;
        dgfemi_apply_cut(d, first, best);
        best->cost = DGFEM_NO_CUT;
        for (i = 0; i < 4; i++) /* twice in a band that follows the cut closely, then twice in a wider one */
            if (!dgfemi_narrow_separator(d, 1 + i / 2, &cost)) break;
        if (!(cost < best_cost * DGFEM_WORTH_IT)) continue;
        best_cost = cost;
        memcpy(d->best_side, d->side, (size_t)d->local.count);
    }
    if (best_cost < DGFEM_NO_CUT) memcpy(d->side, d->best_side, (size_t)d->local.count);
    return best_cost;
}

/* Splits a part into one ahead, one passed and a separator, in this order; `sizes` are theirs. 0 where no cut is worth
   while, as when all places are equal or everything is coupled to everything. */
static int dgfemi_dissect(dgfemi_dissection *d, int first, int last, int sizes[3]) {
    double total = dgfemi_make_local(d, first, last);
    int i;
    if (!(total > 0) || !(dgfemi_find_separator(d, first, total) < DGFEM_NO_CUT)) return 0;
    sizes[0] = sizes[1] = sizes[2] = 0;
    for (i = 0; i < last - first; i++) {
        d->part[d->sorted[0][first + i]] = d->side[i] == DGFEM_SIDE_SEPARATOR ? DGFEM_NONE : d->parts + d->side[i];
        sizes[d->side[i]]++;
    }
    for (i = 0; i < DGFEM_DIRECTIONS; i++) dgfemi_split_list(d, d->sorted[i] + first, last - first, sizes);
    d->parts += 2;
    return 1;
}

/* Separators go behind the two parts that they separate (George 1973); the order within the smallest parts is by
   minimum degree, which sees the separators around them. 0 when out of memory. */
static int dgfemi_nested_dissection(dgfemi_arena *arena, const dgfemi_graph *graph, const dgfem_vec3 *centres,
                                    int *order) {
    dgfemi_dissection dissection, *d = &dissection;
    int n = graph->count, top = 0, ordered = n, i;
    int *stack; /* first and last of the parts still to be cut: disjoint, and none is smaller than the smallest */
    unsigned char *frozen = (unsigned char *)dgfemi_arena_allocate_zero(arena, (size_t)n, 1);
    memset(d, 0, sizeof *d);
    d->graph = graph;
    d->parts = 1;
    stack = (int *)dgfemi_arena_allocate(arena, 2 * ((size_t)n / DGFEM_SMALLEST_PART + 1), sizeof(int));
    if (!frozen || !stack || !dgfemi_dissection_allocate(d, arena) || !dgfemi_dissection_sort(d, arena, centres))
        return 0;
    if (n >= DGFEM_SMALLEST_PART) stack[top++] = 0, stack[top++] = n;
    while (top > 0) {
        int last = stack[--top], first = stack[--top], sizes[3];
        if (!dgfemi_dissect(d, first, last, sizes)) continue;
        for (i = last - sizes[DGFEM_SIDE_SEPARATOR]; i < last; i++) {
            order[--ordered] = d->sorted[0][i];
            frozen[d->sorted[0][i]] = 1;
        }
        for (i = 0; i < 2; first += sizes[i++])
            if (sizes[i] >= DGFEM_SMALLEST_PART) stack[top++] = first, stack[top++] = first + sizes[i];
    }
    return dgfemi_minimum_degree(arena, graph, frozen, order) == ordered;
}

/* ---- elimination tree ---- */

/* position[order[k]] = k; parent[k] is the position of the first row below the diagonal in column k of L (Liu 1990).
   ancestor[count] is scratch: paths already walked, shortened. */
static void dgfemi_elimination_tree(const dgfemi_graph *graph, const int *order, int *position, int *parent,
                                    int *ancestor) {
    int i, k;
    for (i = 0; i < graph->count; i++) position[order[i]] = i;
    for (i = 0; i < graph->count; i++) {
        int v = order[i];
        parent[i] = ancestor[i] = DGFEM_NONE;
        for (k = graph->start[v]; k < graph->start[v + 1]; k++) {
            int j = position[graph->neighbour[k]];
            while (j != DGFEM_NONE && j < i) {
                int next = ancestor[j];
                ancestor[j] = i;
                if (next == DGFEM_NONE) parent[j] = i;
                j = next;
            }
        }
    }
}

/* Lists the nodes of a forest, children before parents, each tree in one piece. child and sibling are scratch. Returns
   their number: nodes whose parent is neither a node nor DGFEM_NONE do not count. */
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

/* The scratch of dgfemi_column_counts, by positions: */
typedef struct dgfemi_counting {
    int *first;    /* number in postorder of the first descendant */
    int *latest;   /* of row k of L: that of the latest leaf of its subtree */
    int *leaf;     /* of row k of L: that leaf */
    int *ancestor; /* on the way up, as far as listed; the highest is its own */
} dgfemi_counting;

/* The highest of the ancestors listed by now. Shortens the way. */
static int dgfemi_highest_ancestor(int *ancestor, int k) {
    while (ancestor[k] != k) k = ancestor[k] = ancestor[ancestor[k]];
    return k;
}

/* Column k has row i of L if k is in the subtree of the elimination tree that has i at its top and that row's entries of
   A as its leaves, or on the way. So the count of column k is a sum over its descendants: +1 for each row that has a leaf
   there, -1 where two of its branches meet and where its subtree ends (Gilbert, Ng, Peyton 1994). Rows weigh as many
   unknowns as they have. The sums are taken modulo 2^32: only the last are small. */
static void dgfemi_count_changes(const dgfemi_graph *graph, const int *order, const int *position, const int *parent,
                                 const int *list, dgfemi_counting *s, unsigned *unknowns, unsigned *blocks) {
    int n = graph->count, k, m;
    for (k = 0; k < n; k++) {
        s->first[k] = s->latest[k] = s->leaf[k] = DGFEM_NONE;
        s->ancestor[k] = k;
        unknowns[k] = blocks[k] = 0;
    }
    for (k = 0; k < n; k++) {
        int j = list[k];
        if (s->first[j] == DGFEM_NONE) unknowns[j] += (unsigned)graph->weight[order[j]], blocks[j]++;
        for (; j != DGFEM_NONE && s->first[j] == DGFEM_NONE; j = parent[j]) s->first[j] = k;
    }
    for (k = 0; k < n; k++) {
        int j = list[k], v = order[j];
        for (m = graph->start[v]; m < graph->start[v + 1]; m++) {
            int i = position[graph->neighbour[m]];
            unsigned weight = (unsigned)graph->weight[graph->neighbour[m]];
            if (i < j || s->first[j] <= s->latest[i]) continue; /* no leaf: row i has one among the descendants */
            unknowns[j] += weight, blocks[j]++;
            if (s->leaf[i] != DGFEM_NONE) {
                int meeting = dgfemi_highest_ancestor(s->ancestor, s->leaf[i]);
                unknowns[meeting] -= weight, blocks[meeting]--;
            }
            s->latest[i] = s->first[j];
            s->leaf[i] = j;
        }
        if (parent[j] == DGFEM_NONE) continue;
        unknowns[parent[j]] -= (unsigned)graph->weight[v], blocks[parent[j]]--;
        s->ancestor[j] = parent[j];
    }
}

/* below[k], the unknowns below the diagonal block in block column k of L, and below_blocks[k] their blocks. list is a
   postorder of the tree. */
static void dgfemi_column_counts(const dgfemi_graph *graph, const int *order, const int *position, const int *parent,
                                 const int *list, dgfemi_counting *scratch, int *below, int *below_blocks) {
    unsigned *unknowns = (unsigned *)(void *)below, *blocks = (unsigned *)(void *)below_blocks;
    int k;
    dgfemi_count_changes(graph, order, position, parent, list, scratch, unknowns, blocks);
    for (k = 0; k < graph->count; k++) {
        if (parent[k] != DGFEM_NONE) unknowns[parent[k]] += unknowns[k], blocks[parent[k]] += blocks[k];
        below[k] -= graph->weight[order[k]];
        below_blocks[k]--;
    }
}

/* Numbers in L and multiplications and additions of the factorization: sums of c and c^2 over the counts c of all
   columns, diagonal included. */
static void dgfemi_factor_cost(const dgfemi_graph *graph, const int *order, const int *below, double *entries,
                               double *flops) {
    int k, j;
    *entries = *flops = 0;
    for (k = 0; k < graph->count; k++)
        for (j = 1; j <= graph->weight[order[k]]; j++) {
            double count = (double)below[k] + j;
            *entries += count;
            *flops += count * count;
        }
}

/* ---- choice ---- */

/* 0 when out of memory. */
static int dgfemi_order_flops(dgfemi_arena *arena, const dgfemi_graph *graph, const int *order, double *flops) {
    int *arrays[9], i;
    dgfemi_counting scratch;
    double entries;
    for (i = 0; i < 9; i++) {
        arrays[i] = (int *)dgfemi_arena_allocate(arena, (size_t)graph->count, sizeof(int));
        if (!arrays[i]) return 0;
    }
    scratch.first = arrays[3], scratch.latest = arrays[4], scratch.leaf = arrays[5], scratch.ancestor = arrays[6];
    dgfemi_elimination_tree(graph, order, arrays[0], arrays[1], arrays[2]);
    dgfemi_postorder(graph->count, arrays[1], arrays[3], arrays[4], arrays[2]);
    dgfemi_column_counts(graph, order, arrays[0], arrays[1], arrays[2], &scratch, arrays[7], arrays[8]);
    dgfemi_factor_cost(graph, order, arrays[7], &entries, flops);
    return 1;
}

/* Nested dissection takes about as long as 2.4e5 multiplications and additions for each block, and saves a tenth of those
   of a factorization, more on large meshes: for two factorizations it is not worth trying where there are fewer. */
#define DGFEM_DISSECTION_FLOPS 1.2e6

/* Nested dissection where there are centres, unless minimum degree needs less work; if `quick` also unless its work is
   little. */
static int dgfemi_order_best(dgfemi_arena *arena, const dgfemi_graph *graph, const dgfem_vec3 *centres, int quick,
                             int *order) {
    double flops, flops_dissection;
    int *dissection;
    if (dgfemi_minimum_degree(arena, graph, NULL, order) == DGFEM_NONE) return 0;
    if (!centres || graph->count < DGFEM_SMALLEST_PART) return 1;
    if (!dgfemi_order_flops(arena, graph, order, &flops)) return 0;
    if (quick && flops < DGFEM_DISSECTION_FLOPS * graph->count) return 1;
    dissection = (int *)dgfemi_arena_allocate(arena, (size_t)graph->count, sizeof(int));
    if (!dissection || !dgfemi_nested_dissection(arena, graph, centres, dissection)) return 0;
    if (!dgfemi_order_flops(arena, graph, dissection, &flops_dissection)) return 0;
    if (flops_dissection < flops) memcpy(order, dissection, (size_t)graph->count * sizeof *order);
    return 1;
}

/* order[k] is the block to eliminate as the k-th. Nested dissection needs centres. 0 when out of memory. */
static int dgfemi_order_blocks(dgfemi_arena *arena, const dgfemi_graph *graph, const dgfem_vec3 *centres,
                               dgfem_ordering ordering, int *order) {
    int i;
    if (graph->count == 0) return 1;
    switch (ordering) {
    case DGFEM_ORDERING_NATURAL:
        for (i = 0; i < graph->count; i++) order[i] = i;
        return 1;
    case DGFEM_ORDERING_MINIMUM_DEGREE: return dgfemi_minimum_degree(arena, graph, NULL, order) != DGFEM_NONE;
    case DGFEM_ORDERING_NESTED_DISSECTION:
        DGFEM_ASSERT(centres);
        return dgfemi_nested_dissection(arena, graph, centres, order);
    case DGFEM_ORDERING_AUTO:
    case DGFEM_ORDERING_QUICK: break;
    }
    return dgfemi_order_best(arena, graph, centres, ordering == DGFEM_ORDERING_QUICK, order);
}
