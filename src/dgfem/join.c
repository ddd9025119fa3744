#pragma once
#include "mesh.c"
#include "planar.c"
/* Directed edges in a plane -> closed loops -> regions, each one outer loop with its holes. */

#define DGFEM_SEGMENT_USED (-2)

/* A directed edge between two vertices; `next` chains those that leave the same vertex. */
typedef struct dgfemi_segment {
    int from, to, next;
} dgfemi_segment;

typedef struct dgfemi_segments {
    dgfemi_segment *data;
    int count, capacity;
} dgfemi_segments;

typedef struct dgfemi_segment_head {
    unsigned generation;
    int first;
} dgfemi_segment_head;

/* Zeroed memory with `mesh` set is a valid one. It serves many planes: what it allocates is kept. */
typedef struct dgfemi_joiner {
    const dgfem_mesh *mesh;
    int *label;                 /* [vertex_count] a hole belongs to a loop of its own label, if there is one; or NULL */
    int drop_open;              /* 1: chains that do not close are dropped; 0: they are an error */
    int axis_u, axis_v;         /* the two coordinates looked at, right-handed about the normal */
    dgfemi_segment_head *heads; /* [vertex_count] first segment that leaves the vertex */
    int heads_capacity;
    unsigned generation;        /* of valid heads */
    dgfemi_ints start;          /* loop l: start[l] <= i < start[l + 1] */
    dgfemi_ints vertices;
    dgfemi_ints owner;          /* [loops] the loop whose region it belongs to */
} dgfemi_joiner;

static void dgfemi_joiner_free(dgfemi_joiner *joiner) {
    const dgfem_hooks *hooks = &joiner->mesh->hooks;
    dgfemi_free(hooks, joiner->heads);
    dgfemi_free(hooks, joiner->start.data);
    dgfemi_free(hooks, joiner->vertices.data);
    dgfemi_free(hooks, joiner->owner.data);
}

/* Makes an array hold `needed` items; new ones are zero. 1 on success, 0 when out of memory. */
static int dgfemi_fit_zero(const dgfem_hooks *hooks, void **data, int *capacity, int needed, size_t size) {
    int old = *capacity;
    void *grown;
    if (needed <= old) return 1;
    grown = dgfemi_grow(hooks, *data, capacity, needed, size);
    if (!grown) return 0;
    *data = grown;
    memset((char *)grown + (size_t)old * size, 0, (size_t)(*capacity - old) * size);
    return 1;
}

static int dgfemi_segment_push(const dgfem_hooks *hooks, dgfemi_segments *segments, int from, int to) {
    dgfemi_segment *segment;
    if (segments->count == segments->capacity) {
        void *grown = dgfemi_grow(hooks, segments->data, &segments->capacity, segments->count + 1,
                                  sizeof(dgfemi_segment));
        if (!grown) return 0;
        segments->data = (dgfemi_segment *)grown;
    }
    segment = &segments->data[segments->count++];
    segment->from = from, segment->to = to, segment->next = DGFEM_NONE;
    return 1;
}

/* ---- loops ---- */

static dgfem_real dgfemi_join_u(const dgfemi_joiner *joiner, int vertex) {
    return dgfemi_axis(joiner->mesh->vertices[vertex], joiner->axis_u);
}

static dgfem_real dgfemi_join_v(const dgfemi_joiner *joiner, int vertex) {
    return dgfemi_axis(joiner->mesh->vertices[vertex], joiner->axis_v);
}

/* Grows from 0 to 4 with the clockwise angle from the direction vertex -> back to the direction vertex -> to; no turn
   at all counts as 360 degrees. */
static dgfem_real dgfemi_join_turn(const dgfemi_joiner *joiner, int back, int vertex, int to) {
    dgfem_real u = dgfemi_join_u(joiner, vertex), v = dgfemi_join_v(joiner, vertex);
    dgfem_real back_u = dgfemi_join_u(joiner, back) - u, back_v = dgfemi_join_v(joiner, back) - v;
    dgfem_real to_u = dgfemi_join_u(joiner, to) - u, to_v = dgfemi_join_v(joiner, to) - v;
    dgfem_real cosine = back_u * to_u + back_v * to_v, sine = to_u * back_v - to_v * back_u;
    dgfem_real sum = dgfemi_abs(cosine) + dgfemi_abs(sine);
    if (!(sum > 0)) return 4;
    cosine /= sum;
    if (sine > 0 || (!(sine < 0) && cosine < 0)) return 1 - cosine;
    return sine < 0 ? 3 + cosine : 4;
}

/* Unlinks a segment from -> to, if there is one, and returns it. */
static int dgfemi_join_unlink(dgfemi_joiner *joiner, dgfemi_segments *segments, int from, int to) {
    dgfemi_segment_head *head = &joiner->heads[from];
    int *link, found;
    if (head->generation != joiner->generation) return DGFEM_NONE;
    for (link = &head->first; *link != DGFEM_NONE; link = &segments->data[*link].next)
        if (segments->data[*link].to == to) break;
    found = *link;
    if (found != DGFEM_NONE) *link = segments->data[found].next;
    return found;
}

/* Lists every segment with the vertex that it leaves. Two opposite ones cancel: both get `from` DGFEM_NONE. 1 on
   success, 0 when out of memory. */
static int dgfemi_join_link(dgfemi_joiner *joiner, dgfemi_segments *segments) {
    void *heads = joiner->heads;
    int i;
    if (!dgfemi_fit_zero(&joiner->mesh->hooks, &heads, &joiner->heads_capacity, joiner->mesh->vertex_count,
                         sizeof(dgfemi_segment_head)))
        return 0;
    joiner->heads = (dgfemi_segment_head *)heads;
    if (++joiner->generation == 0) {
        memset(joiner->heads, 0, (size_t)joiner->heads_capacity * sizeof(dgfemi_segment_head));
        joiner->generation = 1;
    }
    for (i = 0; i < segments->count; i++) {
        dgfemi_segment *segment = &segments->data[i];
        dgfemi_segment_head *head = &joiner->heads[segment->from];
        int opposite = dgfemi_join_unlink(joiner, segments, segment->to, segment->from);
        if (opposite != DGFEM_NONE) {
            segment->from = segments->data[opposite].from = DGFEM_NONE;
            continue;
        }
        if (head->generation != joiner->generation) {
            head->generation = joiner->generation;
            head->first = DGFEM_NONE;
        }
        segment->next = head->first;
        head->first = i;
    }
    return 1;
}

/* Takes the segment that goes on where the given one ends; DGFEM_NONE when there is none. Where several do, the first
   one clockwise from the way back: it bounds the same corner of the area, which is to the left.

            :  \     /
            area \ /  area       in from the upper right, on to the lower right
                 / \
               /     \                                                                            */
static int dgfemi_join_follow(dgfemi_joiner *joiner, dgfemi_segments *segments, int segment) {
    int back = segments->data[segment].from, vertex = segments->data[segment].to, taken;
    dgfemi_segment_head *head = &joiner->heads[vertex];
    int *link, *best = &head->first;
    dgfem_real best_turn = 5;
    if (head->generation != joiner->generation || head->first == DGFEM_NONE) return DGFEM_NONE;
    if (segments->data[head->first].next != DGFEM_NONE)
        for (link = &head->first; *link != DGFEM_NONE; link = &segments->data[*link].next) {
            dgfem_real turn = dgfemi_join_turn(joiner, back, vertex, segments->data[*link].to);
            if (turn < best_turn) best_turn = turn, best = link;
        }
    taken = *best;
    *best = segments->data[taken].next;
    segments->data[taken].next = DGFEM_SEGMENT_USED;
    return taken;
}

/* Fills joiner->start, joiner->vertices. */
static dgfem_status dgfemi_join_loops(dgfemi_joiner *joiner, dgfemi_segments *segments) {
    const dgfem_hooks *hooks = &joiner->mesh->hooks;
    int first, i, end;
    joiner->start.count = joiner->vertices.count = 0;
    if (!dgfemi_join_link(joiner, segments) || !dgfemi_push(hooks, &joiner->start, 0)) return DGFEM_ERROR_MEMORY;
    for (first = 0; first < segments->count; first++) {
        if (segments->data[first].from == DGFEM_NONE || segments->data[first].next == DGFEM_SEGMENT_USED) continue;
        i = first;
        do {
            if (!dgfemi_push(hooks, &joiner->vertices, segments->data[i].from)) return DGFEM_ERROR_MEMORY;
            end = segments->data[i].to;
            i = dgfemi_join_follow(joiner, segments, i);
        } while (i != first && i != DGFEM_NONE);
        if (i == DGFEM_NONE && !joiner->drop_open)
            return dgfemi_fail(hooks, DGFEM_ERROR_INVARIANT, "the cut does not close at vertex %d", end);
        if (i == DGFEM_NONE) {
            joiner->vertices.count = joiner->start.data[joiner->start.count - 1];
            continue;
        }
        if (!dgfemi_push(hooks, &joiner->start, joiner->vertices.count)) return DGFEM_ERROR_MEMORY;
    }
    return DGFEM_OK;
}

/* ---- regions ---- */

static int dgfemi_join_loop_count(const dgfemi_joiner *joiner) { return joiner->start.count - 1; }

/* Twice the area of a loop in the coordinates u, v; *noise: what round-off may have done to it. */
static dgfem_real dgfemi_join_area(const dgfemi_joiner *joiner, int loop, dgfem_real *noise) {
    const int *vertices = joiner->vertices.data + joiner->start.data[loop];
    int count = joiner->start.data[loop + 1] - joiner->start.data[loop], i;
    dgfem_real u = dgfemi_join_u(joiner, vertices[0]), v = dgfemi_join_v(joiner, vertices[0]);
    dgfem_real size = dgfemi_max(dgfemi_abs(u), dgfemi_abs(v)), length = 0, sum = 0, au = 0, av = 0;
    for (i = 1; i < count; i++) {
        dgfem_real bu = dgfemi_join_u(joiner, vertices[i]) - u, bv = dgfemi_join_v(joiner, vertices[i]) - v;
        sum += au * bv - av * bu;
        length += dgfemi_abs(bu - au) + dgfemi_abs(bv - av);
        au = bu, av = bv;
    }
    *noise = 16 * DGFEM_EPSILON * (size + length) * length;
    return sum;
}

/* Whether edge a -> b crosses the ray from (u, v) towards smaller u; where, and whether downwards. Loops may touch:
   round-off does not hide an edge. */
static int dgfemi_join_cross(const dgfemi_joiner *joiner, int a, int b, dgfem_real u, dgfem_real v, dgfem_real *at,
                             int *down) {
    dgfem_real va = dgfemi_join_v(joiner, a), vb = dgfemi_join_v(joiner, b);
    dgfem_real ua = dgfemi_join_u(joiner, a), ub = dgfemi_join_u(joiner, b);
    if ((va > v) == (vb > v)) return 0;
    *down = va > v;
    *at = ua + (v - va) / (vb - va) * (ub - ua);
    return *at <= u + 16 * DGFEM_EPSILON * (dgfemi_abs(ua) + dgfemi_abs(ub) + dgfemi_abs(va) + dgfemi_abs(vb));
}

/* The loop that a ray from this loop's vertex of smallest u towards smaller u meets first. An edge that bounds the
   region there has it on the side of larger u and so runs down, towards smaller v. For a loop that is known to be a
   hole only such edges count; any other loop is a hole if the first edge of all is such a one. Only loops of its
   `label` count, which may be NULL. DGFEM_NONE: no hole.

          |   region    +---+
          v  <----------+   |  hole
          |             +---+                                                                     */
static int dgfemi_join_hole_neighbour(const dgfemi_joiner *joiner, int hole, int known, const int *label) {
    const int *vertices = joiner->vertices.data, *start = joiner->start.data;
    int extreme = vertices[start[hole]], nearest = DGFEM_NONE, nearest_down = 0, loop, i, down;
    dgfem_real u, v, at, best = 0;
    for (i = start[hole]; i < start[hole + 1]; i++)
        if (dgfemi_join_u(joiner, vertices[i]) < dgfemi_join_u(joiner, extreme)) extreme = vertices[i];
    u = dgfemi_join_u(joiner, extreme), v = dgfemi_join_v(joiner, extreme);
    for (loop = 0; loop < dgfemi_join_loop_count(joiner); loop++) {
        int a, b = vertices[start[loop + 1] - 1];
        if (loop == hole || (label && label[b] != label[extreme])) continue;
        for (i = start[loop]; i < start[loop + 1]; i++) {
            a = b, b = vertices[i];
            if (!dgfemi_join_cross(joiner, a, b, u, v, &at, &down) || (known && !down)) continue;
            if (nearest == DGFEM_NONE || at > best) nearest = loop, nearest_down = down, best = at;
        }
    }
    return nearest_down ? nearest : DGFEM_NONE;
}

/* Fills joiner->owner: a loop that runs counter-clockwise owns itself, a hole belongs to its neighbour's owner. A loop
   without area is a slit or a speck, by its surroundings. A hole without neighbour, which takes round-off or a surface
   that crosses itself, becomes a region of its own. */
static dgfem_status dgfemi_join_regions(dgfemi_joiner *joiner) {
    int count = dgfemi_join_loop_count(joiner), loop, steps, *owner;
    joiner->owner.count = 0;
    for (loop = 0; loop < count; loop++)
        if (!dgfemi_push(&joiner->mesh->hooks, &joiner->owner, loop)) return DGFEM_ERROR_MEMORY;
    if (count < 2) return DGFEM_OK;
    owner = joiner->owner.data;
    for (loop = 0; loop < count; loop++) {
        dgfem_real noise, area = dgfemi_join_area(joiner, loop, &noise);
        if (area > noise) continue;
        owner[loop] = dgfemi_join_hole_neighbour(joiner, loop, area < -noise, joiner->label);
        if (owner[loop] == DGFEM_NONE && joiner->label && area < -noise)
            owner[loop] = dgfemi_join_hole_neighbour(joiner, loop, 1, NULL);
        if (owner[loop] == DGFEM_NONE) owner[loop] = loop;
    }
    for (loop = 0; loop < count; loop++) {
        int root = loop;
        for (steps = 0; owner[root] != root && steps < count; steps++) root = owner[root];
        owner[loop] = owner[root] == root ? root : loop; /* no cycles */
    }
    return DGFEM_OK;
}
