#pragma once
#include "linalg.c"
/* Planar regions bounded by loops: which side of a line, simplicity, triangles. Decisions are made on stored
   coordinates with exact arithmetic, so that they never contradict each other.

   A region is projected along the axis nearest to its normal, which only drops one coordinate. Outer loops then run
   counter-clockwise, holes clockwise. */

/* ---- exact orientation ---- */

/* a b = product + *error exactly. Where fma is an instruction it gives the error; elsewhere Dekker's splitting of the
   factors into halves of 26 bits does. */
static double dgfemi_two_product(double a, double b, double *error) {
    const double product = a * b;
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA) || defined(FP_FAST_FMA)
    *error = fma(a, b, -product);
#else
    const double split = 134217729.0, ap = split * a, bp = split * b; /* 2^27 + 1 */
    const double ah = ap - (ap - a), al = a - ah, bh = bp - (bp - b), bl = b - bh;
    *error = ((ah * bh - product) + ah * bl + al * bh) + al * bl;
#endif
    return product;
}

/* a + b = sum + *error exactly (Knuth). */
static double dgfemi_two_sum(double a, double b, double *error) {
    const double sum = a + b, b_part = sum - a, a_part = sum - b_part;
    *error = (a - a_part) + (b - b_part);
    return sum;
}

static int dgfemi_sign(double x) { return (x > 0) - (x < 0); }

/* The determinant without differences, a_x b_y - a_y b_x + ..., summed as an expansion: numbers that do not overlap,
   the last one the largest (J. R. Shewchuk, "Adaptive precision floating-point arithmetic", 1997). */
static int dgfemi_orientation_by_expansion(const double *a, const double *b, const double *c) {
    const double factors[6][2] = {{a[0], b[1]},  {-a[1], b[0]}, {b[0], c[1]},
                                  {-b[1], c[0]}, {c[0], a[1]},  {-c[1], a[0]}};
    double expansion[12];
    int count = 0, i, k, part;
    for (i = 0; i < 6; i++) {
        double parts[2];
        parts[1] = dgfemi_two_product(factors[i][0], factors[i][1], &parts[0]);
        for (part = 0; part < 2; part++) {
            double sum = parts[part];
            for (k = 0; k < count; k++) sum = dgfemi_two_sum(sum, expansion[k], &expansion[k]);
            expansion[count++] = sum;
        }
    }
    while (count > 1 && expansion[count - 1] == 0) count--;
    return dgfemi_sign(expansion[count - 1]);
}

/* 1 when a, b, c turn left, -1 when they turn right, 0 when they lie on a line: exact. */
static int dgfemi_orientation(const double *a, const double *b, const double *c) {
    const double error_bound = 3.3306690738754716e-16; /* of the plain determinant, relative to its two terms */
    double tails[4], p_error, q_error;
    const double ax = dgfemi_two_sum(a[0], -c[0], &tails[0]), by = dgfemi_two_sum(b[1], -c[1], &tails[1]);
    const double ay = dgfemi_two_sum(a[1], -c[1], &tails[2]), bx = dgfemi_two_sum(b[0], -c[0], &tails[3]);
    double p = ax * by, q = ay * bx;
    if (fabs(p - q) > error_bound * (fabs(p) + fabs(q))) return dgfemi_sign(p - q);
    if (tails[0] != 0 || tails[1] != 0 || tails[2] != 0 || tails[3] != 0)
        return dgfemi_orientation_by_expansion(a, b, c);
    p = dgfemi_two_product(ax, by, &p_error);
    q = dgfemi_two_product(ay, bx, &q_error);
    return p != q ? dgfemi_sign(p - q) : dgfemi_sign(p_error - q_error);
}

/* ---- regions ---- */

/* Twice the vector area of a loop. */
static dgfem_vec3 dgfemi_loop_vector_area(const dgfem_vec3 *vertices, const int *loop, int count) {
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    int i;
    for (i = 2; i < count; i++)
        sum = dgfemi_add(sum, dgfemi_cross(dgfemi_sub(vertices[loop[i - 1]], vertices[loop[0]]),
                                           dgfemi_sub(vertices[loop[i]], vertices[loop[0]])));
    return sum;
}

/* The two axes that stay when a region is projected along the largest component of its normal, in the order in which
   its loops keep their sense. */
static void dgfemi_projection_axes(dgfem_vec3 normal, int *u, int *v) {
    const dgfem_real x = dgfemi_abs(normal.x), y = dgfemi_abs(normal.y), z = dgfemi_abs(normal.z);
    const int dropped = x > y && x > z ? 0 : y > z ? 1 : 2;
    const int forward = dgfemi_axis(normal, dropped) >= 0;
    *u = (dropped + (forward ? 1 : 2)) % 3;
    *v = (dropped + (forward ? 2 : 1)) % 3;
}

/* Corners are nodes of circular lists, one for each loop; node i belongs to loop_of[i]. */
typedef struct dgfemi_planar {
    double (*point)[2];
    int *vertex, *next, *previous, *loop_of;
    int *loop_start;   /* [loop_count + 1] original nodes of each loop */
    double *loop_area; /* twice */
    unsigned char *reflex;
    int *reflex_nodes; /* those with reflex[] set, and some that had it once */
    int node_count, loop_count, reflex_count;
} dgfemi_planar;

/* Nodes that bridges to holes may add: two for each loop but one. */
static int dgfemi_planar_allocate(dgfemi_planar *p, dgfemi_arena *arena, int corners, int loops) {
    const size_t nodes = (size_t)corners + 2 * (size_t)loops;
    p->point = (double(*)[2])dgfemi_arena_allocate(arena, nodes, sizeof *p->point);
    p->vertex = (int *)dgfemi_arena_allocate(arena, nodes, sizeof(int));
    p->next = (int *)dgfemi_arena_allocate(arena, nodes, sizeof(int));
    p->previous = (int *)dgfemi_arena_allocate(arena, nodes, sizeof(int));
    p->loop_of = (int *)dgfemi_arena_allocate(arena, nodes, sizeof(int));
    p->reflex = (unsigned char *)dgfemi_arena_allocate(arena, nodes, 1);
    p->reflex_nodes = (int *)dgfemi_arena_allocate(arena, nodes, sizeof(int));
    p->loop_start = (int *)dgfemi_arena_allocate(arena, (size_t)loops + 1, sizeof(int));
    p->loop_area = (double *)dgfemi_arena_allocate(arena, (size_t)loops, sizeof(double));
    return p->point && p->vertex && p->next && p->previous && p->loop_of && p->reflex && p->reflex_nodes &&
           p->loop_start && p->loop_area;
}

static void dgfemi_planar_add_loop(dgfemi_planar *p, const dgfem_vec3 *vertices, const int *loop, int count, int u,
                                   int v) {
    const int start = p->node_count;
    double area = 0;
    int i;
    for (i = 0; i < count; i++) {
        const int node = start + i;
        p->vertex[node] = loop[i];
        p->point[node][0] = (double)dgfemi_axis(vertices[loop[i]], u);
        p->point[node][1] = (double)dgfemi_axis(vertices[loop[i]], v);
        p->next[node] = i + 1 < count ? node + 1 : start;
        p->previous[node] = i > 0 ? node - 1 : start + count - 1;
        p->loop_of[node] = p->loop_count;
    }
    for (i = start + 1; i + 1 < start + count; i++)
        area += (p->point[i][0] - p->point[start][0]) * (p->point[i + 1][1] - p->point[start][1]) -
                (p->point[i][1] - p->point[start][1]) * (p->point[i + 1][0] - p->point[start][0]);
    p->loop_area[p->loop_count++] = area;
    p->loop_start[p->loop_count] = p->node_count = start + count;
}

/* The region of loop_count loops; loop l has the vertices loop_vertices[loop_start[l] .. loop_start[l + 1] - 1]. 0 when
   out of memory. */
static int dgfemi_planar_make(dgfemi_planar *p, dgfemi_arena *arena, const dgfem_vec3 *vertices,
                              const int *loop_vertices, const int *loop_start, int loop_count, dgfem_vec3 normal) {
    int u, v, l;
    if (!dgfemi_planar_allocate(p, arena, loop_start[loop_count] - loop_start[0], loop_count)) return 0;
    p->node_count = p->loop_count = p->reflex_count = 0;
    p->loop_start[0] = 0;
    dgfemi_projection_axes(normal, &u, &v);
    for (l = 0; l < loop_count; l++)
        dgfemi_planar_add_loop(p, vertices, loop_vertices + loop_start[l], loop_start[l + 1] - loop_start[l], u, v);
    return 1;
}

static int dgfemi_planar_turn(const dgfemi_planar *p, int a, int b, int c) {
    return dgfemi_orientation(p->point[a], p->point[b], p->point[c]);
}

static double dgfemi_larger(double a, double b) { return a > b ? a : b; }
static double dgfemi_smaller(double a, double b) { return a < b ? a : b; }

/* Whether the boxes of the segments a-b and c-d meet along one axis. */
static int dgfemi_planar_overlap(const dgfemi_planar *p, int a, int b, int c, int d, int axis) {
    const double as = p->point[a][axis], bs = p->point[b][axis], cs = p->point[c][axis], ds = p->point[d][axis];
    return dgfemi_larger(as, bs) >= dgfemi_smaller(cs, ds) && dgfemi_larger(cs, ds) >= dgfemi_smaller(as, bs);
}

/* Whether the closed segments a-b and c-d have a point in common. */
static int dgfemi_planar_meet(const dgfemi_planar *p, int a, int b, int c, int d) {
    if (!dgfemi_planar_overlap(p, a, b, c, d, 0) || !dgfemi_planar_overlap(p, a, b, c, d, 1)) return 0;
    return dgfemi_planar_turn(p, a, b, c) * dgfemi_planar_turn(p, a, b, d) <= 0 &&
           dgfemi_planar_turn(p, c, d, a) * dgfemi_planar_turn(p, c, d, b) <= 0;
}

/* ---- simplicity ---- */

/* Whether the edge b-c runs back over the edge a-b. */
static int dgfemi_planar_folds(const dgfemi_planar *p, int a, int b, int c) {
    int axis;
    if (dgfemi_planar_turn(p, a, b, c) != 0) return 0;
    for (axis = 0; axis < 2; axis++) {
        const double at = p->point[a][axis], bt = p->point[b][axis], ct = p->point[c][axis];
        if ((at > bt && ct > bt) || (at < bt && ct < bt)) return 1;
    }
    return 0;
}

static double dgfemi_planar_left_end(const dgfemi_planar *p, int edge) {
    return dgfemi_smaller(p->point[edge][0], p->point[p->next[edge]][0]);
}

/* Heap sort of edges by their left end. */
static void dgfemi_planar_sort_edges(const dgfemi_planar *p, int *edges, int count) {
    int root, last = count, start = count / 2;
    while (last > 1) {
        int moved;
        if (start > 0) {
            moved = edges[--start];
        } else {
            moved = edges[--last];
            edges[last] = edges[0];
        }
        for (root = start; 2 * root + 1 < last;) {
            int child = 2 * root + 1;
            if (child + 1 < last &&
                dgfemi_planar_left_end(p, edges[child]) < dgfemi_planar_left_end(p, edges[child + 1]))
                child++;
            if (dgfemi_planar_left_end(p, edges[child]) <= dgfemi_planar_left_end(p, moved)) break;
            edges[root] = edges[child];
            root = child;
        }
        edges[root] = moved;
    }
}

static int dgfemi_planar_edges_clash(const dgfemi_planar *p, int e, int f) {
    if (p->next[e] == f) return dgfemi_planar_folds(p, e, f, p->next[f]);
    if (p->next[f] == e) return dgfemi_planar_folds(p, f, e, p->next[e]);
    return dgfemi_planar_meet(p, e, p->next[e], f, p->next[f]);
}

/* Two edges, named by their first nodes, that cross or touch; 0 when there are none. Uses reflex_nodes. */
static int dgfemi_planar_find_clash(dgfemi_planar *p, int *first, int *second) {
    int *edges = p->reflex_nodes;
    int i, j;
    for (i = 0; i < p->node_count; i++) edges[i] = i;
    dgfemi_planar_sort_edges(p, edges, p->node_count);
    for (i = 0; i < p->node_count; i++) {
        const double right = dgfemi_larger(p->point[edges[i]][0], p->point[p->next[edges[i]]][0]);
        for (j = i + 1; j < p->node_count && dgfemi_planar_left_end(p, edges[j]) <= right; j++)
            if (dgfemi_planar_edges_clash(p, edges[i], edges[j])) {
                *first = edges[i], *second = edges[j];
                return 1;
            }
    }
    return 0;
}

/* How often the edge a-b winds counter-clockwise round q as seen along the ray from q to the right: 1, 0 or -1. An end
   on the ray counts as below it, so that no corner counts twice or is missed. */
static int dgfemi_edge_winding(const double *a, const double *b, const double *q) {
    if (a[1] <= q[1] && b[1] > q[1]) return dgfemi_orientation(a, b, q) > 0;
    if (b[1] <= q[1] && a[1] > q[1]) return dgfemi_orientation(b, a, q) > 0 ? -1 : 0;
    return 0;
}

/* A loop that lies on the wrong side of the others, or DGFEM_NONE: outer loops must lie outside the region that the
   others bound, holes inside. For loops that do not meet. */
static int dgfemi_planar_find_misplaced(const dgfemi_planar *p) {
    int l, i;
    for (l = 0; p->loop_count > 1 && l < p->loop_count; l++) {
        int winding = 0;
        for (i = 0; i < p->node_count; i++)
            if (p->loop_of[i] != l)
                winding += dgfemi_edge_winding(p->point[i], p->point[p->next[i]], p->point[p->loop_start[l]]);
        if (winding != (p->loop_area[l] > 0 ? 0 : 1)) return l;
    }
    return DGFEM_NONE;
}

/* ---- triangles: bridges join holes to other loops, then ears are clipped ---- */

/* Whether the direction from node a to node b points strictly into the region at a. */
static int dgfemi_planar_in_cone(const dgfemi_planar *p, int a, int b) {
    const int before = p->previous[a], after = p->next[a];
    if (dgfemi_planar_turn(p, before, a, after) >= 0)
        return dgfemi_planar_turn(p, a, b, before) > 0 && dgfemi_planar_turn(p, b, a, after) > 0;
    return !(dgfemi_planar_turn(p, a, b, after) >= 0 && dgfemi_planar_turn(p, b, a, before) >= 0);
}

static int dgfemi_planar_is_right_of(const dgfemi_planar *p, int a, int b) {
    return p->point[a][0] > p->point[b][0] || (p->point[a][0] == p->point[b][0] && p->point[a][1] > p->point[b][1]);
}

static int dgfemi_planar_rightmost(const dgfemi_planar *p, int loop) {
    int best = p->loop_start[loop], i;
    for (i = best + 1; i < p->loop_start[loop + 1]; i++)
        if (dgfemi_planar_is_right_of(p, i, best)) best = i;
    return best;
}

/* Whether the segment between nodes a and b touches no edge but those that end at their vertices, and lies in the
   region at both ends. */
static int dgfemi_planar_sees(const dgfemi_planar *p, int a, int b) {
    int i;
    if (!dgfemi_planar_in_cone(p, a, b) || !dgfemi_planar_in_cone(p, b, a)) return 0;
    for (i = 0; i < p->node_count; i++) {
        const int from = p->vertex[i], to = p->vertex[p->next[i]];
        if (from == p->vertex[a] || from == p->vertex[b] || to == p->vertex[a] || to == p->vertex[b]) continue;
        if (dgfemi_planar_meet(p, a, b, i, p->next[i])) return 0;
    }
    return 1;
}

/* Of the nodes that qualify, the one that follows in the order of distance from `from` (ties by number) after *distance
   and `last`; DGFEM_NONE at the end. A node qualifies when it lies right of `from` or, with any_side, when it
   belongs to another group of joined loops. */
static int dgfemi_planar_next_nearest(const dgfemi_planar *p, const int *group, int from, int any_side, int last,
                                      double *distance) {
    double best_distance = 0;
    int best = DGFEM_NONE, i;
    for (i = 0; i < p->node_count; i++) {
        const double dx = p->point[i][0] - p->point[from][0], dy = p->point[i][1] - p->point[from][1];
        const double d = dx * dx + dy * dy;
        if (any_side ? group[p->loop_of[i]] == group[p->loop_of[from]] : !dgfemi_planar_is_right_of(p, i, from))
            continue;
        if (last != DGFEM_NONE && (d < *distance || (d == *distance && i <= last))) continue;
        if (best == DGFEM_NONE || d < best_distance) best = i, best_distance = d;
    }
    *distance = best_distance;
    return best;
}

/* Makes one loop of two:  .. a b ..  and  .. m ..  become  .. a m .. m' a' b ..  where a' and m' are copies. */
static void dgfemi_planar_bridge(dgfemi_planar *p, int a, int m) {
    const int m_copy = p->node_count++, a_copy = p->node_count++, b = p->next[a], before = p->previous[m];
    p->vertex[m_copy] = p->vertex[m], p->vertex[a_copy] = p->vertex[a];
    memcpy(p->point[m_copy], p->point[m], sizeof p->point[m]);
    memcpy(p->point[a_copy], p->point[a], sizeof p->point[a]);
    p->loop_of[m_copy] = p->loop_of[m], p->loop_of[a_copy] = p->loop_of[a];
    p->next[a] = m, p->previous[m] = a;
    p->next[before] = m_copy, p->previous[m_copy] = before;
    p->next[m_copy] = a_copy, p->previous[a_copy] = m_copy;
    p->next[a_copy] = b, p->previous[b] = a_copy;
}

/* Joins a hole to the nearest node to the right of its rightmost vertex that sees it. In a region that is simple there
   always is one, and it cannot belong to what was joined to the hole before, since that all lies to the left. In any
   other region the nearest node of another group must do. */
static void dgfemi_planar_join_hole(dgfemi_planar *p, int *group, int hole) {
    const int rightmost = dgfemi_planar_rightmost(p, hole);
    const int original_count = p->loop_start[p->loop_count];
    double distance = 0;
    int at = rightmost, target = DGFEM_NONE, found = 0, merged, l;
    while (!found && (target = dgfemi_planar_next_nearest(p, group, rightmost, 0, target, &distance)) != DGFEM_NONE) {
        if (group[p->loop_of[target]] == group[hole]) continue;
        at = rightmost;
        found = dgfemi_planar_sees(p, at, target);
        for (l = original_count; !found && l < p->node_count; l++) /* copies made by bridges that end here */
            if (p->vertex[l] == p->vertex[rightmost]) found = dgfemi_planar_sees(p, at = l, target);
    }
    if (!found) at = rightmost, target = dgfemi_planar_next_nearest(p, group, at, 1, DGFEM_NONE, &distance);
    DGFEM_ASSERT(target != DGFEM_NONE);
    merged = group[p->loop_of[target]];
    for (l = 0; l < p->loop_count; l++)
        if (group[l] == merged) group[l] = group[hole];
    dgfemi_planar_bridge(p, target, at);
}

/* The loop that is not to be joined although its area is not positive: only where no loop has one. */
static int dgfemi_planar_lone_outer(const dgfemi_planar *p) {
    int l, best = 0;
    for (l = 0; l < p->loop_count; l++)
        if (p->loop_area[l] > 0) return DGFEM_NONE;
    for (l = 1; l < p->loop_count; l++)
        if (dgfemi_planar_is_right_of(p, dgfemi_planar_rightmost(p, l), dgfemi_planar_rightmost(p, best))) best = l;
    return best;
}

static int dgfemi_planar_is_hole(const dgfemi_planar *p, int loop, int lone_outer) {
    return !(p->loop_area[loop] > 0) && loop != lone_outer;
}

static void dgfemi_planar_set_reflex(dgfemi_planar *p, int node) {
    p->reflex[node] = dgfemi_planar_turn(p, p->previous[node], node, p->next[node]) <= 0;
}

static int dgfemi_planar_in_triangle(const dgfemi_planar *p, int a, int b, int c, int q) {
    int axis;
    for (axis = 0; axis < 2; axis++) {
        const double t = p->point[q][axis], x = p->point[a][axis], y = p->point[b][axis], z = p->point[c][axis];
        if ((t < x && t < y && t < z) || (t > x && t > y && t > z)) return 0;
    }
    return dgfemi_planar_turn(p, a, b, q) >= 0 && dgfemi_planar_turn(p, b, c, q) >= 0 &&
           dgfemi_planar_turn(p, c, a, q) >= 0;
}

/* Whether the triangle of a node and its neighbours can be cut off: it has area, its third side lies in the region, and
   no other vertex lies in it or on that side. Only vertices with an angle of 180 degrees or more need a look. */
static int dgfemi_planar_is_ear(dgfemi_planar *p, int node) {
    const int before = p->previous[node], after = p->next[node];
    int i = 0;
    if (p->reflex[node] || !dgfemi_planar_in_cone(p, before, after) || !dgfemi_planar_in_cone(p, after, before))
        return 0;
    while (i < p->reflex_count) {
        const int other = p->reflex_nodes[i], v = p->vertex[other];
        if (!p->reflex[other]) { /* no longer: angles only shrink */
            p->reflex_nodes[i] = p->reflex_nodes[--p->reflex_count];
            continue;
        }
        if (v != p->vertex[before] && v != p->vertex[node] && v != p->vertex[after] &&
            dgfemi_planar_in_triangle(p, before, node, after, other))
            return 0;
        i++;
    }
    return 1;
}

typedef struct dgfemi_triangles {
    int *data;
    int capacity, count; /* count goes on beyond capacity */
} dgfemi_triangles;

/* Cuts off the node and the triangle with its neighbours. */
static void dgfemi_planar_clip(dgfemi_planar *p, int node, dgfemi_triangles *out) {
    const int before = p->previous[node], after = p->next[node];
    if (out->count < out->capacity) {
        int *t = out->data + 3 * out->count;
        t[0] = p->vertex[before], t[1] = p->vertex[node], t[2] = p->vertex[after];
    }
    out->count++;
    p->next[before] = after, p->previous[after] = before;
    p->reflex[node] = 0;
    dgfemi_planar_set_reflex(p, before);
    dgfemi_planar_set_reflex(p, after);
}

/* A loop that is simple always has an ear. In any other, where a whole round finds none, a convex corner goes. */
static void dgfemi_planar_clip_loop(dgfemi_planar *p, int node, dgfemi_triangles *out) {
    int left = 1, misses = 0, i;
    for (i = p->next[node]; i != node; i = p->next[i]) left++;
    while (left >= 3) {
        const int force = misses > left && (!p->reflex[node] || misses > 2 * left);
        if (left == 3 || force || dgfemi_planar_is_ear(p, node)) {
            const int after = p->next[node];
            dgfemi_planar_clip(p, node, out);
            node =
                left > 4 ? p->next[after] : after; /* not twice at the same corner: that would make fans of slivers */
            left--;
            misses = 0;
        } else {
            node = p->next[node];
            misses++;
        }
    }
}

/* Number of triangles: a loop of n corners gives n - 2, a hole of n corners n + 2. */
static int dgfemi_planar_triangle_count(const dgfemi_planar *p) {
    const int lone_outer = dgfemi_planar_lone_outer(p);
    int count = p->loop_start[p->loop_count], l;
    for (l = 0; l < p->loop_count; l++) count += dgfemi_planar_is_hole(p, l, lone_outer) ? 2 : -2;
    return count;
}

/* Triangles that cover the region. Where it is not simple they have the right boundary but may overlap. `group` is room
   for one int per loop. Consumes the lists. */
static void dgfemi_planar_triangulate(dgfemi_planar *p, int *group, dgfemi_triangles *out) {
    const int lone_outer = dgfemi_planar_lone_outer(p);
    int l, i;
    for (l = 0; l < p->loop_count; l++) group[l] = l;
    for (l = 0; l < p->loop_count; l++)
        if (dgfemi_planar_is_hole(p, l, lone_outer)) dgfemi_planar_join_hole(p, group, l);
    p->reflex_count = 0;
    for (i = 0; i < p->node_count; i++) {
        dgfemi_planar_set_reflex(p, i);
        if (p->reflex[i]) p->reflex_nodes[p->reflex_count++] = i;
    }
    for (l = 0; l < p->loop_count; l++)
        if (!dgfemi_planar_is_hole(p, l, lone_outer)) dgfemi_planar_clip_loop(p, p->loop_start[l], out);
}
