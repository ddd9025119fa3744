#pragma once
#include "blade.c"
#include "body.c"
#include "join.c"
#include "skin.c"
/* Cutting a render mesh along with its body.

   The skin's positions in the world decide. Vertices are below, above, or on the blade's plane (0). A triangle that
   crosses the plane is split along its chord; where a polygon ends within the chord, tips are inserted:

          + v0                          Points p, q are made once for each edge, tips once for each chord. Only the
           / \                          parts of the chord inside the polygon are slit: p-c here, not c-q. There the
       p  /   \  q                      sides get vertices of their own. An edge between a triangle below and one above
    -----o--c--o-----                   lies in the plane, so the classes of (vertex, triangle) pairs that are connected
        / \ | / \                       through edges off the slit are simple: a vertex of the slit has one below and
       /___\|/___\                      one above, or only one, if an edge that is not slit joins the two (a tip).
    - v1         - v2

   A vertex may appear several times in the caller's mesh (seams of texture coordinates). Those of one place are one
   `weld`, named by its first vertex; signs, slits and caps are decided on welds.

   The slit's edges, closed along the polygon's boundary, bound the regions of the cross-section. Triangulated, and
   refined inside, they are the walls, with vertices of their own. */

/* Ends of an edge nearer to the plane than this part of its length across the plane count as on it, and vertices nearer
   than this part of the skin's size. */
#define DGFEM_SKIN_SNAP DGFEM_R(1e-4)
#define DGFEM_SKIN_FLAT (DGFEM_REAL_IS_FLOAT ? DGFEM_R(4e-6) : DGFEM_R(1e-8))

enum { DGFEMI_BELOW = 1, DGFEMI_ABOVE = 2, DGFEMI_LINKED = 4, DGFEMI_SLIT = 8 };

/* An old vertex of the skin, or a new point: of an edge, or a tip. */
typedef struct dgfemi_skin_point {
    dgfem_vec3 world, rest, anchor;
    int weld;      /* the point that stands for all of this place, itself included */
    int element;   /* that carried it before all blades */
    int parent[2]; /* points; DGFEM_NONE for old vertices */
    dgfem_real t;
    int out[2]; /* vertices of the result, below and above; the same where the point is not separated */
    /* of welds: */
    int sign;     /* -1, 0, 1 */
    int flags;    /* what surrounds it */
    int first[2]; /* lowest vertex of the result below, above */
    int cap;      /* point of the cross-section */
} dgfemi_skin_point;

typedef struct dgfemi_skin_part {
    int corner[3]; /* points */
    int source, wall;
    int of;   /* triangle that it is a part of; DGFEM_NONE: no area is left of it */
    int side; /* DGFEMI_BELOW, DGFEMI_ABOVE, or both: not split though it crosses the plane */
} dgfemi_skin_part;

/* An edge between two points, in the order of their welds, with its new points from a to b. In a second table an edge
   between welds in the plane, with the sides of its triangles. */
typedef struct dgfemi_skin_edge {
    int a, b;
    int first, count;
    int flags;
} dgfemi_skin_edge;

typedef struct dgfemi_skin_edges {
    dgfemi_skin_edge *data;
    int count, capacity;
    dgfemi_buckets buckets;
} dgfemi_skin_edges;

/* A point of the cross-section. */
typedef struct dgfemi_cap_point {
    int weld;      /* point of the skin, or DGFEM_NONE inside */
    int element, layer;
    int parent[2]; /* of points between two others: points of the cross-section */
    dgfem_vec3 world, rest;
    int out[2]; /* vertices of the walls */
} dgfemi_cap_point;

/* A vertex of the result. */
typedef struct dgfemi_skin_vertex {
    dgfem_vec3 rest, anchor, world;
    int parent[2];
    dgfem_real weight;
    int weld, element;
    int side; /* -1, 1, or 0 where it does not matter */
    int slit; /* 1: it has a counterpart on the other side */
} dgfemi_skin_vertex;

typedef struct dgfemi_skin_cutter {
    const dgfem_skin *skin;
    const dgfem_body *body;
    const dgfemi_blade *blade;
    const dgfem_hooks *hooks;
    const dgfem_body *before; /* all blades */
    int last;                 /* 1: no further blade follows */
    dgfemi_ints *element;     /* [the skin's vertices] of `before` */
    int *layer;               /* [elements of `before`] that the blade meets them in; DGFEM_NONE */
    int layer_count;
    dgfemi_skin_point *points;
    int point_count, point_capacity;
    dgfemi_skin_part *parts;
    int part_count, part_capacity;
    char *split; /* [triangles] whether its chord is (partly) slit */
    dgfemi_skin_edges edges, plane_edges;
    double *clips; /* room for the parameters of one chord's clips */
    int clip_count;
    dgfemi_segments segments; /* of the cross-section, between cap points */
    dgfemi_cap_point *caps;
    int cap_count, cap_capacity;
    dgfemi_ints cap_triangles;
    dgfemi_skin_vertex *vertices;
    int vertex_count, vertex_capacity;
    dgfemi_ints triangles; /* of the result, three vertices each */
} dgfemi_skin_cutter;

static void dgfemi_skin_cutter_free(dgfemi_skin_cutter *c) {
    dgfemi_free(c->hooks, c->layer);
    dgfemi_free(c->hooks, c->points);
    dgfemi_free(c->hooks, c->parts);
    dgfemi_free(c->hooks, c->split);
    dgfemi_free(c->hooks, c->edges.data);
    dgfemi_buckets_free(c->hooks, &c->edges.buckets);
    dgfemi_free(c->hooks, c->plane_edges.data);
    dgfemi_buckets_free(c->hooks, &c->plane_edges.buckets);
    dgfemi_free(c->hooks, c->clips);
    dgfemi_free(c->hooks, c->segments.data);
    dgfemi_free(c->hooks, c->caps);
    dgfemi_free(c->hooks, c->cap_triangles.data);
    dgfemi_free(c->hooks, c->vertices);
    dgfemi_free(c->hooks, c->triangles.data);
}

/* Room for one more item of a growable array; NULL when out of memory. */
static void *dgfemi_one_more(const dgfem_hooks *hooks, void *data, int count, int *capacity, size_t size) {
    return count < *capacity ? data : dgfemi_grow(hooks, data, capacity, count + 1, size);
}

/* ---- points ---- */

static dgfemi_skin_point *dgfemi_skin_weld(const dgfemi_skin_cutter *c, int point) {
    return &c->points[c->points[point].weld];
}

static dgfem_vec3 dgfemi_skin_world(const dgfemi_skin_cutter *c, int point) {
    return dgfemi_skin_weld(c, point)->world;
}

static int dgfemi_skin_sign(const dgfemi_skin_cutter *c, int point) { return dgfemi_skin_weld(c, point)->sign; }

/* A new point between two others; `weld` DGFEM_NONE: it is alone. Returns its index, DGFEM_NONE when out of memory. */
static int dgfemi_skin_add_point(dgfemi_skin_cutter *c, int a, int b, dgfem_real t, int weld) {
    void *grown = dgfemi_one_more(c->hooks, c->points, c->point_count, &c->point_capacity, sizeof *c->points);
    dgfemi_skin_point *p;
    const dgfemi_skin_point *pa, *pb;
    if (!grown) return DGFEM_NONE;
    c->points = (dgfemi_skin_point *)grown;
    p = &c->points[c->point_count], pa = &c->points[a], pb = &c->points[b];
    memset(p, 0, sizeof *p);
    p->rest = dgfemi_add_scaled(pa->rest, t, dgfemi_sub(pb->rest, pa->rest));
    p->anchor = dgfemi_add_scaled(pa->anchor, t, dgfemi_sub(pb->anchor, pa->anchor));
    p->world =
        dgfemi_add_scaled(dgfemi_skin_world(c, a), t, dgfemi_sub(dgfemi_skin_world(c, b), dgfemi_skin_world(c, a)));
    p->parent[0] = a, p->parent[1] = b, p->t = t, p->element = pa->element;
    p->weld = weld == DGFEM_NONE ? c->point_count : weld;
    p->out[0] = p->out[1] = p->first[0] = p->first[1] = p->cap = DGFEM_NONE;
    return c->point_count++;
}

/* Before the first cut, vertices with equal rest positions are one. 1 on success. */
static int dgfemi_skin_find_welds(dgfemi_skin_cutter *c) {
    const dgfem_vec3 *rest = c->skin->embedding->points;
    dgfemi_buckets buckets;
    int ok;
    memset(&buckets, 0, sizeof buckets);
    ok = dgfemi_buckets_reset(c->hooks, &buckets, c->skin->vertex_count);
    for (int v = 0; ok && v < c->skin->vertex_count; v++) {
        uint64_t hash = dgfemi_hash_position(rest[v]);
        int i = dgfemi_buckets_first(&buckets, hash);
        while (i != DGFEM_NONE && !dgfemi_same_position(rest[i], rest[v])) i = buckets.next[i];
        c->points[v].weld = i == DGFEM_NONE ? v : i;
        if (i == DGFEM_NONE) ok = dgfemi_buckets_insert(c->hooks, &buckets, v, hash);
    }
    dgfemi_buckets_free(c->hooks, &buckets);
    return ok;
}

/* The skin's vertices as points and its triangles as parts. 1 on success. */
static int dgfemi_skin_cutter_begin(dgfemi_skin_cutter *c) {
    const dgfem_skin *skin = c->skin;
    size_t vertices = (size_t)skin->vertex_count, triangles = (size_t)skin->triangle_count;
    int corners = c->blade->polygon ? c->blade->polygon_count : 0;
    c->points = (dgfemi_skin_point *)dgfemi_allocate_zero(c->hooks, vertices, sizeof *c->points);
    c->parts = (dgfemi_skin_part *)dgfemi_allocate(c->hooks, triangles, sizeof *c->parts);
    c->split = (char *)dgfemi_allocate_zero(c->hooks, triangles, 1);
    c->clips = (double *)dgfemi_allocate(c->hooks, (size_t)corners + 2, sizeof(double));
    if (!c->points || !c->parts || !c->split || !c->clips) return 0;
    c->point_count = skin->vertex_count, c->point_capacity = skin->vertex_count ? skin->vertex_count : 1;
    c->part_count = skin->triangle_count, c->part_capacity = skin->triangle_count ? skin->triangle_count : 1;
    for (int v = 0; v < skin->vertex_count; v++) {
        dgfemi_skin_point *p = &c->points[v];
        p->world = skin->positions[v], p->rest = skin->embedding->points[v];
        p->anchor = skin->anchors ? skin->anchors[v] : p->rest;
        p->weld = skin->weld ? skin->weld[v] : v, p->element = c->element->data[v];
        p->parent[0] = p->parent[1] = p->out[0] = p->out[1] = p->first[0] = p->first[1] = p->cap = DGFEM_NONE;
    }
    for (int t = 0; t < skin->triangle_count; t++) {
        memcpy(c->parts[t].corner, skin->triangles + 3 * t, sizeof c->parts[t].corner);
        c->parts[t].source = skin->source ? skin->source[t] : t;
        c->parts[t].wall = skin->wall ? skin->wall[t] : 0;
        c->parts[t].of = t, c->parts[t].side = 0;
    }
    return dgfemi_buckets_reset(c->hooks, &c->edges.buckets, skin->triangle_count / 4) &&
           dgfemi_buckets_reset(c->hooks, &c->plane_edges.buckets, skin->triangle_count / 4) &&
           (skin->weld || dgfemi_skin_find_welds(c));
}

/* ---- signs ---- */

/* Vertices this near to the plane are on it. */
static dgfem_real dgfemi_skin_flatness(const dgfemi_skin_cutter *c) {
    dgfem_vec3 lower = c->points[0].world, upper = lower;
    dgfem_real size;
    for (int v = 1; v < c->point_count; v++) {
        lower = dgfemi_min3(lower, c->points[v].world);
        upper = dgfemi_max3(upper, c->points[v].world);
    }
    size = dgfemi_max(dgfemi_norm(lower), dgfemi_norm(upper));
    return dgfemi_max(DGFEM_SKIN_FLAT * dgfemi_distance(lower, upper), 16 * DGFEM_EPSILON * size);
}

/* Of the elements, by volume: small ones that cuts leave do not count for much. */
static dgfem_real dgfemi_skin_mean_radius(const dgfem_mesh *mesh) {
    dgfem_real sum = 0, volume = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        sum += mesh->elements[e].volume * mesh->elements[e].radius;
        volume += mesh->elements[e].volume;
    }
    return volume > 0 ? sum / volume : 0;
}

/* Vertices of earlier walls nearer to the plane than this part of the elements' radius count as on it. So a stroke goes
   on where the last one ended, though its slit has moved a little, and walls are not cut into ever thinner slices. */
#define DGFEM_SKIN_WALL_SNAP DGFEM_R(0.05)

/* Signs of all welds; then those too near to the plane on an edge that crosses it become zero. */
static void dgfemi_skin_find_signs(dgfemi_skin_cutter *c) {
    dgfem_real flat = c->point_count > 0 ? dgfemi_skin_flatness(c) : 0;
    dgfem_real wall_flat = DGFEM_SKIN_WALL_SNAP * dgfemi_skin_mean_radius(c->body->mesh);
    for (int v = 0; v < c->point_count; v++) {
        dgfem_real d = dgfemi_blade_distance(c->blade, c->points[v].world);
        c->points[v].sign = (d > flat) - (d < -flat);
    }
    for (int i = 0; i < 3 * c->part_count; i++) {
        dgfemi_skin_point *p = dgfemi_skin_weld(c, c->parts[i / 3].corner[i % 3]);
        if (c->parts[i / 3].wall && dgfemi_abs(dgfemi_blade_distance(c->blade, p->world)) < wall_flat) p->sign = 0;
    }
    for (int i = 0; i < 3 * c->part_count; i++) {
        const int *corner = c->parts[i / 3].corner;
        dgfemi_skin_point *a = dgfemi_skin_weld(c, corner[i % 3]), *b = dgfemi_skin_weld(c, corner[(i + 1) % 3]);
        dgfem_real da, db;
        da = dgfemi_abs(dgfemi_blade_distance(c->blade, a->world));
        db = dgfemi_abs(dgfemi_blade_distance(c->blade, b->world));
        if ((dgfemi_blade_distance(c->blade, a->world) > 0) == (dgfemi_blade_distance(c->blade, b->world) > 0))
            continue;
        if (da < DGFEM_SKIN_SNAP * (da + db)) a->sign = 0;
        if (db < DGFEM_SKIN_SNAP * (da + db)) b->sign = 0;
    }
}

/* The side of a triangle of points: that of its corners off the plane; in the plane, that of the material behind it. */
static int dgfemi_skin_side(const dgfemi_skin_cutter *c, const int *corner) {
    int side = 0;
    dgfem_vec3 x[3];
    for (int k = 0; k < 3; k++) {
        int sign = dgfemi_skin_sign(c, corner[k]);
        if (sign) side |= sign < 0 ? DGFEMI_BELOW : DGFEMI_ABOVE;
        x[k] = dgfemi_skin_world(c, corner[k]);
    }
    if (side) return side;
    return dgfemi_dot(dgfemi_cross(dgfemi_sub(x[1], x[0]), dgfemi_sub(x[2], x[0])), c->blade->normal) < 0
               ? DGFEMI_ABOVE
               : DGFEMI_BELOW;
}

/* ---- edges ---- */

/* Finds the edge of two indices, in this order. DGFEM_NONE when there is none. */
static int dgfemi_skin_edge_find(const dgfemi_skin_edges *edges, int a, int b) {
    int i = dgfemi_buckets_first(&edges->buckets, dgfemi_hash_pair(a, b));
    while (i != DGFEM_NONE && (edges->data[i].a != a || edges->data[i].b != b)) i = edges->buckets.next[i];
    return i;
}

/* Finds or makes it; DGFEM_NONE when out of memory. */
static int dgfemi_skin_edge_make(const dgfem_hooks *hooks, dgfemi_skin_edges *edges, int a, int b) {
    int i = dgfemi_skin_edge_find(edges, a, b);
    void *grown;
    if (i != DGFEM_NONE) return i;
    grown = dgfemi_one_more(hooks, edges->data, edges->count, &edges->capacity, sizeof *edges->data);
    if (!grown) return DGFEM_NONE;
    edges->data = (dgfemi_skin_edge *)grown;
    memset(&edges->data[edges->count], 0, sizeof *edges->data);
    edges->data[edges->count].a = a, edges->data[edges->count].b = b;
    if (!dgfemi_buckets_insert(hooks, &edges->buckets, edges->count, dgfemi_hash_pair(a, b))) return DGFEM_NONE;
    return edges->count++;
}

/* Puts two points in the order of their welds: seams then compute the same numbers on both sides. */
static int dgfemi_skin_order(const dgfemi_skin_cutter *c, int *a, int *b) {
    int swap = *a, wa = c->points[*a].weld, wb = c->points[*b].weld;
    if (wa < wb || (wa == wb && *a < *b)) return 0;
    *a = *b, *b = swap;
    return 1;
}

/* Where the line between two points of opposite signs crosses the plane, in the order of their welds. */
static dgfem_real dgfemi_skin_crossing(const dgfemi_skin_cutter *c, int a, int b, dgfem_vec3 *at) {
    dgfem_vec3 xa, xb;
    dgfem_real da, db, t;
    (void)dgfemi_skin_order(c, &a, &b);
    xa = dgfemi_skin_world(c, a), xb = dgfemi_skin_world(c, b);
    da = dgfemi_blade_distance(c->blade, xa), db = dgfemi_blade_distance(c->blade, xb);
    t = da / (da - db);
    *at = dgfemi_add_scaled(xa, t, dgfemi_sub(xb, xa));
    return t;
}

/* Gives an edge new points at the parameters t[count] from a to b, each the copy of one at the weld numbered on from
   `welds`, if that is not DGFEM_NONE; unless it has some already. 1 on success. */
static int dgfemi_skin_edge_fill(dgfemi_skin_cutter *c, int a, int b, const double *t, int count, int welds) {
    int edge = dgfemi_skin_edge_make(c->hooks, &c->edges, a, b), first = c->point_count;
    if (edge == DGFEM_NONE) return 0;
    if (c->edges.data[edge].count > 0) return 1;
    for (int i = 0; i < count; i++) {
        double at = welds == DGFEM_NONE ? t[i] : (double)c->points[welds + i].t;
        int weld = welds == DGFEM_NONE ? DGFEM_NONE : welds + i;
        if (dgfemi_skin_add_point(c, a, b, (dgfem_real)at, weld) == DGFEM_NONE) return 0;
    }
    c->edges.data[edge].first = first, c->edges.data[edge].count = count;
    return 1;
}

/* Divides the edge between the welds of two points, in their order. */
static int dgfemi_skin_edge_divide(dgfemi_skin_cutter *c, int a, int b, const double *t, int count) {
    return dgfemi_skin_edge_fill(c, c->points[a].weld, c->points[b].weld, t, count, DGFEM_NONE);
}

/* Gives the edges of all triangles the points of their welds' edges. 1 on success. */
static int dgfemi_skin_divide_seams(dgfemi_skin_cutter *c) {
    if (c->edges.count == 0) return 1;
    for (int i = 0; i < 3 * c->part_count; i++) {
        int a = c->parts[i / 3].corner[i % 3], b = c->parts[i / 3].corner[(i + 1) % 3], edge;
        (void)dgfemi_skin_order(c, &a, &b);
        edge = dgfemi_skin_edge_find(&c->edges, c->points[a].weld, c->points[b].weld);
        if (edge == DGFEM_NONE || c->points[a].weld == c->points[b].weld) continue;
        if (!dgfemi_skin_edge_fill(c, a, b, NULL, c->edges.data[edge].count, c->edges.data[edge].first)) return 0;
    }
    return 1;
}

/* The i-th new point of the edge from a to b, in this direction; DGFEM_NONE beyond the last. */
static int dgfemi_skin_edge_point(const dgfemi_skin_cutter *c, int a, int b, int i) {
    int backward = dgfemi_skin_order(c, &a, &b);
    int edge = dgfemi_skin_edge_find(&c->edges, a, b);
    const dgfemi_skin_edge *e = edge == DGFEM_NONE ? NULL : &c->edges.data[edge];
    if (!e || i >= e->count) return DGFEM_NONE;
    return e->first + (backward ? e->count - 1 - i : i);
}

/* ---- clips ---- */

static int dgfemi_compare_doubles(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Fills c->clips with the parameters, ascending, at which the segment from p to q in the plane goes into or out of the
   polygon, and returns whether some part of it lies inside. */
static int dgfemi_skin_clip(dgfemi_skin_cutter *c, dgfem_vec3 p, dgfem_vec3 q) {
    const dgfemi_blade *blade = c->blade;
    double a[2], b[2], x[2], y[2];
    int count = 0, kept = 0, inside, was_inside = 0, some = 0;
    c->clip_count = 0;
    if (!blade->polygon) return 1;
    dgfemi_blade_project(blade, p, x), dgfemi_blade_project(blade, q, y);
    dgfemi_blade_project(blade, blade->polygon[blade->polygon_count - 1], b);
    for (int i = 0; i < blade->polygon_count; i++) {
        double dx, dy, ex, ey, t;
        memcpy(a, b, sizeof a);
        dgfemi_blade_project(blade, blade->polygon[i], b);
        if (dgfemi_orientation(a, b, x) * dgfemi_orientation(a, b, y) > 0) continue;
        if (dgfemi_orientation(x, y, a) * dgfemi_orientation(x, y, b) > 0) continue;
        dx = y[0] - x[0], dy = y[1] - x[1], ex = b[0] - a[0], ey = b[1] - a[1];
        t = ((a[0] - x[0]) * ey - (a[1] - x[1]) * ex) / (dx * ey - dy * ex);
        if (t > (double)DGFEM_SKIN_SNAP && t < 1 - (double)DGFEM_SKIN_SNAP) c->clips[count++] = t;
    }
    qsort(c->clips, (size_t)count, sizeof(double), dgfemi_compare_doubles);
    for (int i = 0; i <= count; i++) { /* a clip stays where the segment is inside on one of its sides only */
        double from = i > 0 ? c->clips[i - 1] : 0, to = i < count ? c->clips[i] : 1;
        if (i > 0 && i < count && to - from < (double)DGFEM_SKIN_SNAP) continue;
        inside = dgfemi_blade_covers(blade, dgfemi_add_scaled(p, (dgfem_real)(0.5 * (from + to)), dgfemi_sub(q, p)));
        if (i > 0 && inside != was_inside) c->clips[kept++] = from;
        was_inside = inside, some |= inside;
    }
    c->clip_count = kept;
    return some;
}

/* ---- which chords are slit ---- */

/* Turns a triangle that crosses the plane so that its first corner is the one on the plane, or the only one on its
   side. 0: the triangle does not cross. */
static int dgfemi_skin_turn(const dgfemi_skin_cutter *c, const int *corner, int *turned) {
    int sign[3], below = 0, above = 0, first = 0;
    for (int k = 0; k < 3; k++) {
        sign[k] = dgfemi_skin_sign(c, corner[k]);
        below += sign[k]<0, above += sign[k]> 0;
    }
    if (!below || !above) return 0;
    for (int k = 0; k < 3; k++)
        if (below + above == 2 ? sign[k] == 0 : sign[k] == (below == 1 ? -1 : 1)) first = k;
    for (int k = 0; k < 3; k++) turned[k] = corner[(first + k) % 3];
    return 1;
}

/* The ends of a turned triangle's chord in the world: on the edge 0-1 or at corner 0, and on the edge 2-0 or 1-2. */
static void dgfemi_skin_chord(const dgfemi_skin_cutter *c, const int *turned, dgfem_vec3 *p, dgfem_vec3 *q) {
    if (dgfemi_skin_sign(c, turned[0]) == 0) {
        *p = dgfemi_skin_world(c, turned[0]);
        (void)dgfemi_skin_crossing(c, turned[1], turned[2], q);
    } else {
        (void)dgfemi_skin_crossing(c, turned[0], turned[1], p);
        (void)dgfemi_skin_crossing(c, turned[2], turned[0], q);
    }
}

static int dgfemi_skin_divide_at_plane(dgfemi_skin_cutter *c, int a, int b) {
    dgfem_vec3 at;
    double t = (double)dgfemi_skin_crossing(c, a, b, &at);
    (void)dgfemi_skin_order(c, &a, &b);
    return dgfemi_skin_edge_divide(c, a, b, &t, 1);
}

/* An edge in the plane that the polygon ends in is divided there. 1 on success. */
static int dgfemi_skin_divide_in_plane(dgfemi_skin_cutter *c, int a, int b) {
    if (c->points[a].weld == c->points[b].weld) return 1;
    (void)dgfemi_skin_order(c, &a, &b);
    (void)dgfemi_skin_clip(c, dgfemi_skin_world(c, a), dgfemi_skin_world(c, b));
    return c->clip_count == 0 || dgfemi_skin_edge_divide(c, a, b, c->clips, c->clip_count);
}

/* Marks the triangles to be split and makes the points of their edges. 1 on success. */
static int dgfemi_skin_find_chords(dgfemi_skin_cutter *c) {
    for (int i = 0; i < c->part_count; i++) {
        const int *corner = c->parts[i].corner;
        int turned[3], first;
        dgfem_vec3 p, q;
        for (int k = 0; c->blade->polygon && k < 3; k++) {
            int a = corner[k], b = corner[(k + 1) % 3];
            if (dgfemi_skin_sign(c, a) || dgfemi_skin_sign(c, b)) continue;
            if (!dgfemi_skin_divide_in_plane(c, a, b)) return 0;
        }
        if (!dgfemi_skin_turn(c, corner, turned)) continue;
        dgfemi_skin_chord(c, turned, &p, &q);
        if (!dgfemi_skin_clip(c, p, q)) continue;
        c->split[i] = 1;
        first = dgfemi_skin_sign(c, turned[0]) ? 0 : 1;
        if (first == 1 && !dgfemi_skin_divide_at_plane(c, turned[1], turned[2])) return 0;
        if (first == 0 && (!dgfemi_skin_divide_at_plane(c, turned[0], turned[1]) ||
                           !dgfemi_skin_divide_at_plane(c, turned[2], turned[0])))
            return 0;
    }
    return dgfemi_skin_divide_seams(c);
}

/* ---- splitting ---- */

/* A part of triangle `of`, in its place if that is still free (`*placed` is 0), else at the end. 1 on success. */
static int dgfemi_skin_add_part(dgfemi_skin_cutter *c, int of, int *placed, int p, int q, int r) {
    dgfemi_skin_part part = c->parts[of];
    part.corner[0] = p, part.corner[1] = q, part.corner[2] = r;
    if (*placed) {
        void *grown = dgfemi_one_more(c->hooks, c->parts, c->part_count, &c->part_capacity, sizeof *c->parts);
        if (!grown) return 0;
        c->parts = (dgfemi_skin_part *)grown;
        c->parts[c->part_count++] = part;
    } else {
        c->parts[of] = part;
        *placed = 1;
    }
    return 1;
}

/* The triangles between an apex and an edge from a to b with its new points. A triangle next to a or b whose other
   edge has points too is divided once more, as that edge's fan. */
static int dgfemi_skin_fan(dgfemi_skin_cutter *c, int of, int *placed, int apex, int a, int b) {
    int from = a, to, i = 0, inner;
    do {
        int outer_from = DGFEM_NONE, outer_to = DGFEM_NONE, last = from, opposite;
        to = dgfemi_skin_edge_point(c, a, b, i++);
        if (to == DGFEM_NONE) to = b;
        if (from == a) outer_from = apex, outer_to = a;
        if (to == b && (from != a || dgfemi_skin_edge_point(c, apex, a, 0) == DGFEM_NONE))
            outer_from = b, outer_to = apex;
        opposite = outer_from == b ? from : to;
        if (outer_from == DGFEM_NONE || dgfemi_skin_edge_point(c, outer_from, outer_to, 0) == DGFEM_NONE) {
            if (!dgfemi_skin_add_part(c, of, placed, apex, from, to)) return 0;
        } else {
            last = outer_from;
            for (int k = 0; last != outer_to; k++) {
                inner = dgfemi_skin_edge_point(c, outer_from, outer_to, k);
                if (inner == DGFEM_NONE) inner = outer_to;
                if (!dgfemi_skin_add_part(c, of, placed, opposite, last, inner)) return 0;
                last = inner;
            }
        }
        from = to;
    } while (to != b);
    return 1;
}

/* A triangle that does not cross, but has new points on edges in the plane. */
static int dgfemi_skin_split_edges(dgfemi_skin_cutter *c, int of, const int *corner) {
    int placed = 0;
    for (int k = 0; k < 3; k++) {
        int a = corner[k], b = corner[(k + 1) % 3];
        if (dgfemi_skin_edge_point(c, a, b, 0) == DGFEM_NONE) continue;
        return dgfemi_skin_fan(c, of, &placed, corner[(k + 2) % 3], a, b);
    }
    return 1;
}

/* The i-th point of a chord: its ends p and q and the tips between, which are numbered on from `tips`. */
static int dgfemi_chord_point(int p, int q, int tips, int tip_count, int i) {
    return i == 0 ? p : i > tip_count ? q : tips + i - 1;
}

/* Splits along the chord from p to q with its tips; a: corner (or corners a, b) to its left, r to its right. */
static int dgfemi_skin_split_chord(dgfemi_skin_cutter *c, int of, const int *v, int p, int q) {
    int placed = 0, tips, tip_count, lone = p != v[0], best = 0;
    dgfem_real shortest = -1;
    if (!dgfemi_skin_clip(c, dgfemi_skin_world(c, p), dgfemi_skin_world(c, q))) c->clip_count = 0;
    tips = c->point_count, tip_count = c->clip_count;
    for (int i = 0; i < tip_count; i++)
        if (dgfemi_skin_add_point(c, p, q, (dgfem_real)c->clips[i], DGFEM_NONE) == DGFEM_NONE) return 0;
    for (int i = 0; lone && i <= tip_count + 1; i++) { /* where the quad's two fans meet */
        dgfem_vec3 x = dgfemi_skin_world(c, dgfemi_chord_point(p, q, tips, tip_count, i));
        dgfem_real length =
            dgfemi_distance(x, dgfemi_skin_world(c, v[1])) + dgfemi_distance(x, dgfemi_skin_world(c, v[2]));
        if (shortest < 0 || length < shortest) shortest = length, best = i;
    }
    for (int i = 0; i <= tip_count; i++) {
        int from = dgfemi_chord_point(p, q, tips, tip_count, i), to = dgfemi_chord_point(p, q, tips, tip_count, i + 1);
        int left = lone ? v[0] : v[2], right = lone && i >= best ? v[2] : v[1];
        if (!dgfemi_skin_add_part(c, of, &placed, left, from, to)) return 0;
        if (!dgfemi_skin_add_part(c, of, &placed, right, to, from)) return 0;
    }
    if (!lone) return 1;
    return dgfemi_skin_add_part(c, of, &placed, v[1], v[2], dgfemi_chord_point(p, q, tips, tip_count, best));
}

/* Splits a triangle as its edges and its chord ask. 1 on success. */
static int dgfemi_skin_split_triangle(dgfemi_skin_cutter *c, int of) {
    int v[3], corner[3], p, q, placed = 0;
    memcpy(corner, c->parts[of].corner, sizeof corner);
    if (!dgfemi_skin_turn(c, corner, v)) return dgfemi_skin_split_edges(c, of, corner);
    if (dgfemi_skin_sign(c, v[0]) == 0) {
        q = dgfemi_skin_edge_point(c, v[1], v[2], 0);
        return q == DGFEM_NONE || dgfemi_skin_split_chord(c, of, v, v[0], q);
    }
    p = dgfemi_skin_edge_point(c, v[0], v[1], 0), q = dgfemi_skin_edge_point(c, v[2], v[0], 0);
    if (p != DGFEM_NONE && q != DGFEM_NONE) return dgfemi_skin_split_chord(c, of, v, p, q);
    if (p != DGFEM_NONE)
        return dgfemi_skin_add_part(c, of, &placed, v[0], p, v[2]) &&
               dgfemi_skin_add_part(c, of, &placed, p, v[1], v[2]);
    if (q != DGFEM_NONE)
        return dgfemi_skin_add_part(c, of, &placed, v[0], v[1], q) &&
               dgfemi_skin_add_part(c, of, &placed, q, v[1], v[2]);
    return 1;
}

static int dgfemi_skin_split_all(dgfemi_skin_cutter *c) {
    int count = c->part_count;
    if (c->edges.count == 0) return 1;
    for (int i = 0; i < count; i++)
        if (!dgfemi_skin_split_triangle(c, i)) return 0;
    return 1;
}

/* ---- short edges along the blade ---- */

/* New points on earlier walls nearer to each other than this part of the elements' radius become one. Without it every
   cut through the thin triangles of a wall would leave as many points as it meets edges, and its own walls thinner
   triangles yet. Walls are flat, and lose little; the skin as it was made keeps all its points. */
#define DGFEM_SKIN_WALL_SPACING DGFEM_R(0.25)

/* Whether a point may move to another one: new, on an edge, not on a seam, where it has copies, and no tip's parent. */
static int dgfemi_skin_is_free(const dgfemi_skin_cutter *c, const char *kept, int point) {
    const dgfemi_skin_point *p = &c->points[point];
    int old = c->skin->vertex_count;
    return point >= old && p->weld == point && !kept[point] && p->parent[0] < old && p->parent[1] < old;
}

static int dgfemi_skin_merged(int *into, int point) {
    while (into[point] != point) point = into[point] = into[into[point]];
    return point;
}

/* Fills into[points]: the point that each is merged with. */
static void dgfemi_skin_merge_points(const dgfemi_skin_cutter *c, const char *kept, int *into) {
    dgfem_real spacing = DGFEM_SKIN_WALL_SPACING * dgfemi_skin_mean_radius(c->body->mesh);
    for (int i = 0; i < c->point_count; i++) into[i] = i;
    for (int i = 0; i < 3 * c->part_count; i++) {
        int a = c->parts[i / 3].corner[i % 3], b = c->parts[i / 3].corner[(i + 1) % 3];
        if (!c->parts[i / 3].wall || dgfemi_skin_sign(c, a) || dgfemi_skin_sign(c, b)) continue;
        a = dgfemi_skin_merged(into, a), b = dgfemi_skin_merged(into, b);
        if (c->points[a].weld == c->points[b].weld) continue;
        if (!(dgfemi_distance(dgfemi_skin_world(c, a), dgfemi_skin_world(c, b)) < spacing)) continue;
        if (dgfemi_skin_is_free(c, kept, b)) into[b] = a;
        else if (dgfemi_skin_is_free(c, kept, a)) into[a] = b;
    }
}

/* Drops the parts of which merging has left nothing; a triangle's place goes to another part of it. */
static void dgfemi_skin_drop_parts(dgfemi_skin_cutter *c) {
    int kept = 0;
    for (int i = c->skin->triangle_count; i < c->part_count; i++) {
        dgfemi_skin_part *part = &c->parts[i];
        if (part->of == DGFEM_NONE || c->parts[part->of].of != DGFEM_NONE) continue;
        c->parts[part->of] = *part;
        part->of = DGFEM_NONE;
    }
    for (int i = 0; i < c->part_count; i++)
        if (c->parts[i].of != DGFEM_NONE) c->parts[kept++] = c->parts[i];
    c->part_count = kept;
}

/* 1 on success. */
static int dgfemi_skin_merge_short_edges(dgfemi_skin_cutter *c) {
    int *into = (int *)dgfemi_allocate(c->hooks, (size_t)c->point_count, sizeof(int));
    char *kept = (char *)dgfemi_allocate_zero(c->hooks, (size_t)c->point_count, 1);
    int ok = into && kept;
    for (int i = c->skin->vertex_count; ok && i < c->point_count; i++) {
        if (c->points[i].weld != i) kept[c->points[i].weld] = 1;
        for (int k = 0; k < 2; k++) kept[c->points[i].parent[k]] = 1;
    }
    if (ok) dgfemi_skin_merge_points(c, kept, into);
    for (int i = 0; ok && i < c->part_count; i++) {
        int *corner = c->parts[i].corner;
        for (int k = 0; k < 3; k++) corner[k] = dgfemi_skin_merged(into, corner[k]);
        if (corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0]) c->parts[i].of = DGFEM_NONE;
    }
    if (ok) dgfemi_skin_drop_parts(c);
    for (int i = 0; ok && i < c->part_count; i++) c->parts[i].side = dgfemi_skin_side(c, c->parts[i].corner);
    dgfemi_free(c->hooks, into);
    dgfemi_free(c->hooks, kept);
    return ok;
}

/* ---- the slit ---- */

static dgfemi_skin_edge *dgfemi_skin_plane_edge(const dgfemi_skin_cutter *c, int a, int b) {
    int edge = dgfemi_skin_edge_find(&c->plane_edges, a < b ? a : b, a < b ? b : a);
    return edge == DGFEM_NONE ? NULL : &c->plane_edges.data[edge];
}

/* The welds of the k-th edge of a part when both its ends are on the plane, else 0. */
static int dgfemi_skin_part_edge(const dgfemi_skin_cutter *c, const dgfemi_skin_part *part, int k, int *a, int *b) {
    *a = c->points[part->corner[k]].weld, *b = c->points[part->corner[(k + 1) % 3]].weld;
    return *a != *b && c->points[*a].sign == 0 && c->points[*b].sign == 0;
}

/* Collects the sides around the points and edges on the plane, and decides which edges are slit. 1 on success. */
static int dgfemi_skin_find_slit(dgfemi_skin_cutter *c) {
    for (int i = 0; i < 3 * c->part_count; i++) {
        const dgfemi_skin_part *part = &c->parts[i / 3];
        int a, b, edge;
        dgfemi_skin_weld(c, part->corner[i % 3])->flags |=
            part->side == (DGFEMI_BELOW | DGFEMI_ABOVE) ? part->side | DGFEMI_LINKED : part->side;
        if (!dgfemi_skin_part_edge(c, part, i % 3, &a, &b)) continue;
        edge = dgfemi_skin_edge_make(c->hooks, &c->plane_edges, a < b ? a : b, a < b ? b : a);
        if (edge == DGFEM_NONE) return 0;
        c->plane_edges.data[edge].flags |= part->side;
    }
    for (int i = 0; i < c->plane_edges.count; i++) {
        dgfemi_skin_edge *edge = &c->plane_edges.data[i];
        dgfemi_skin_point *a = &c->points[edge->a], *b = &c->points[edge->b];
        if (edge->flags != (DGFEMI_BELOW | DGFEMI_ABOVE)) continue;
        edge->flags |= dgfemi_blade_covers(c->blade, dgfemi_scale(DGFEM_R(0.5), dgfemi_add(a->world, b->world)))
                           ? DGFEMI_SLIT
                           : DGFEMI_LINKED;
        a->flags |= edge->flags, b->flags |= edge->flags;
    }
    return 1;
}

/* Whether a weld has a vertex on each side. Without a slit at it: where two sides touch in this point alone. */
static int dgfemi_skin_is_separated(const dgfemi_skin_cutter *c, const dgfemi_skin_point *weld) {
    const int both = DGFEMI_BELOW | DGFEMI_ABOVE;
    if (weld->sign != 0 || (weld->flags & both) != both || weld->flags & DGFEMI_LINKED) return 0;
    return weld->flags & DGFEMI_SLIT || dgfemi_blade_covers(c->blade, weld->world);
}
