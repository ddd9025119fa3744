#pragma once
#include "skin_layer.c"
/* Second part of cutting a render mesh: the cross-section. The slit's edges, closed along the polygon's boundary, are
   joined to loops and regions, triangulated, and refined inside. */

/* ---- the cross-section ---- */

/* A point of the cross-section: at a weld, or with weld DGFEM_NONE between two others or by itself. DGFEM_NONE when out
   of memory. */
static int dgfemi_skin_add_cap(dgfemi_skin_cutter *c, int weld, int a, int b, dgfem_vec3 world, dgfem_vec3 rest,
                               int element, int layer) {
    void *grown = dgfemi_one_more(c->hooks, c->caps, c->cap_count, &c->cap_capacity, sizeof *c->caps);
    dgfemi_cap_point *cap;
    if (!grown) return DGFEM_NONE;
    c->caps = (dgfemi_cap_point *)grown;
    cap = &c->caps[c->cap_count];
    cap->weld = weld, cap->parent[0] = a, cap->parent[1] = b;
    cap->element = element, cap->layer = layer;
    cap->world = world, cap->rest = rest;
    cap->out[0] = cap->out[1] = DGFEM_NONE;
    return c->cap_count++;
}

static int dgfemi_skin_cap_at(dgfemi_skin_cutter *c, int weld) {
    dgfemi_skin_point *p = &c->points[weld];
    if (p->cap == DGFEM_NONE)
        p->cap = dgfemi_skin_add_cap(c, weld, DGFEM_NONE, DGFEM_NONE, p->world, p->rest, p->element, DGFEM_NONE);
    return p->cap;
}

/* The slit's edges as the triangles above see them: the cross-section is on their left, seen from the normal's tip. */
static int dgfemi_skin_find_segments(dgfemi_skin_cutter *c) {
    for (int i = 0; i < 3 * c->part_count; i++) {
        const dgfemi_skin_part *part = &c->parts[i / 3];
        int a, b, from, to;
        if (part->side != DGFEMI_ABOVE || !dgfemi_skin_part_edge(c, part, i % 3, &a, &b)) continue;
        if (!(dgfemi_skin_plane_edge(c, a, b)->flags & DGFEMI_SLIT)) continue;
        from = dgfemi_skin_cap_at(c, a), to = dgfemi_skin_cap_at(c, b);
        if (from == DGFEM_NONE || to == DGFEM_NONE || !dgfemi_segment_push(c->hooks, &c->segments, from, to)) return 0;
    }
    return 1;
}

static int dgfemi_skin_wind(const dgfemi_blade *blade, dgfem_vec3 from, dgfem_vec3 to, const double *q) {
    double a[2], b[2];
    dgfemi_blade_project(blade, from, a), dgfemi_blade_project(blade, to, b);
    return dgfemi_edge_winding(a, b, q);
}

/* How often the whole cross-section, slit or not, winds round a point of the plane: 0 outside the body. */
static int dgfemi_skin_section_winding(const dgfemi_skin_cutter *c, dgfem_vec3 x) {
    double q[2];
    int winding = 0;
    dgfemi_blade_project(c->blade, x, q);
    for (int i = 0; i < c->part_count; i++) {
        const dgfemi_skin_part *part = &c->parts[i];
        int v[3], a, b;
        dgfem_vec3 from, to;
        for (int k = 0; part->side == DGFEMI_ABOVE && k < 3; k++)
            if (dgfemi_skin_part_edge(c, part, k, &a, &b) && dgfemi_skin_plane_edge(c, a, b)->flags & DGFEMI_BELOW)
                winding += dgfemi_skin_wind(c->blade, c->points[a].world, c->points[b].world, q);
        if (!dgfemi_skin_turn(c, part->corner, v)) continue;
        dgfemi_skin_chord(c, v, &from, &to); /* with v[0], or else v[2], on its left */
        if (dgfemi_skin_sign(c, dgfemi_skin_sign(c, v[0]) ? v[0] : v[2]) > 0)
            winding += dgfemi_skin_wind(c->blade, from, to, q);
        else winding += dgfemi_skin_wind(c->blade, to, from, q);
    }
    return winding;
}

/* ---- the polygon's boundary inside the body ---- */

/* Where the slit leaves the polygon (1) or enters it (-1): along its boundary, edge + fraction, counter-clockwise. */
typedef struct dgfemi_tip {
    double at;
    int cap, leaves, layer;
} dgfemi_tip;

static int dgfemi_compare_tips(const void *a, const void *b) {
    const dgfemi_tip *s = (const dgfemi_tip *)a, *t = (const dgfemi_tip *)b;
    if (s->layer != t->layer) return s->layer < t->layer ? -1 : 1;
    if (s->at != t->at) return s->at < t->at ? -1 : 1;
    if (s->leaves != t->leaves) return s->leaves - t->leaves;
    return (s->cap > t->cap) - (s->cap < t->cap);
}

static int dgfemi_blade_is_clockwise(const dgfemi_blade *blade) {
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    for (int i = 2; i < blade->polygon_count; i++)
        sum = dgfemi_add(sum, dgfemi_cross(dgfemi_sub(blade->polygon[i - 1], blade->polygon[0]),
                                           dgfemi_sub(blade->polygon[i], blade->polygon[0])));
    return dgfemi_dot(sum, blade->normal) < 0;
}

/* Corner i of the polygon, counter-clockwise. */
static dgfem_vec3 dgfemi_blade_corner(const dgfemi_blade *blade, int clockwise, int i) {
    i %= blade->polygon_count;
    return blade->polygon[clockwise ? blade->polygon_count - 1 - i : i];
}

static double dgfemi_blade_place(const dgfemi_blade *blade, int clockwise, dgfem_vec3 x) {
    dgfem_real nearest = -1;
    double at = 0;
    for (int i = 0; i < blade->polygon_count; i++) {
        dgfem_vec3 a = dgfemi_blade_corner(blade, clockwise, i), b = dgfemi_blade_corner(blade, clockwise, i + 1);
        dgfem_vec3 foot = dgfemi_nearest_on_segment(a, b, x);
        dgfem_real distance = dgfemi_distance(foot, x), length = dgfemi_distance(a, b);
        if (nearest >= 0 && !(distance < nearest)) continue;
        nearest = distance;
        at = i + (length > 0 ? 0.999999 * (double)(dgfemi_distance(foot, a) / length) : 0);
    }
    return at;
}

/* Appends segments along the polygon's boundary from a cap point past corners first, first + step, .. to another;
   without these two, a whole round. 1 on success. */
static int dgfemi_skin_follow_polygon(dgfemi_skin_cutter *c, int from, int to, int first, int corners, int step,
                                      int layer) {
    int clockwise = dgfemi_blade_is_clockwise(c->blade);
    for (int i = 0; i < corners; i++) {
        dgfem_vec3 x = dgfemi_blade_corner(c->blade, clockwise, first + i * step), rest;
        int cap, element;
        if (dgfemi_skin_rest_of(c, x, layer, &rest, &element) > DGFEM_CORNER_REACH) continue;
        cap = dgfemi_skin_add_cap(c, DGFEM_NONE, DGFEM_NONE, DGFEM_NONE, x, rest, element, layer);
        if (cap == DGFEM_NONE || (from != DGFEM_NONE && !dgfemi_segment_push(c->hooks, &c->segments, from, cap)))
            return 0;
        if (from == DGFEM_NONE) to = cap;
        from = cap;
    }
    return from == to || dgfemi_segment_push(c->hooks, &c->segments, from, to);
}

/* Tips of one layer in the order in which the polygon's boundary leaves it (where the slit enters the polygon) and
   enters it by turns. Some share a place, as where it crosses both walls of an earlier slit: there the turns decide.
   The second round knows which turn it is at the first tip. */
static void dgfemi_order_tips(dgfemi_tip *tips, int count) {
    for (int round = 0; round < 2; round++)
        for (int i = 0; i + 1 < count; i++) {
            dgfemi_tip swap = tips[i];
            int last = tips[i > 0 ? i - 1 : count - 1].leaves;
            if (swap.leaves != last || tips[i + 1].leaves == last || tips[i + 1].at - swap.at > 2e-6) continue;
            tips[i] = tips[i + 1], tips[i + 1] = swap;
        }
}

/* Whether the first corner of the polygon lies in the layer (1) or not (0), as the tips tell: the boundary is inside
   once between places where it enters and leaves, else outside, but for short stretches. */
static int dgfemi_skin_starts_inside(const dgfemi_tip *tips, int count, int corners) {
    double wrong[2] = {0, 0}, at = tips[count - 1].at - corners;
    int level = 0;
    for (int i = 0; i < count; i++) {
        wrong[0] += level < 0 || level > 1 ? tips[i].at - at : 0;
        wrong[1] += level < -1 || level > 0 ? tips[i].at - at : 0;
        level += tips[i].leaves, at = tips[i].at;
    }
    return wrong[1] < wrong[0];
}

/* Joins each place where the slit leaves the polygon with one where it enters it again. Along the boundary, from a
   place outside the layer, these are nested like brackets: between them it runs inside, or, where flaps overlap in
   the world or are turned inside out, inside several times or minus once. open: room for `count` tips. 1 on
   success. */
static int dgfemi_skin_join_tips(dgfemi_skin_cutter *c, const dgfemi_tip *tips, int count, const dgfemi_tip **open) {
    int corners = c->blade->polygon_count, depth = 0, first = 0;
    int winding = dgfemi_skin_starts_inside(tips, count, corners);
    for (int i = 0; i < count && winding != 0; i++) {
        winding += tips[i].leaves;
        first = i + 1;
    }
    for (int i = first; i < first + count; i++) {
        const dgfemi_tip *tip = &tips[i % count], *last = depth > 0 ? open[depth - 1] : NULL;
        int ahead, between;
        if (!last || last->leaves == tip->leaves) {
            open[depth++] = tip;
            continue;
        }
        depth--;
        ahead = last->leaves == 1; /* the way goes from where the slit leaves the polygon */
        between = (int)tip->at - (int)last->at + (tip < last ? corners : 0);
        if (between > corners) between = corners;
        if (!dgfemi_skin_follow_polygon(c, ahead ? last->cap : tip->cap, ahead ? tip->cap : last->cap,
                                        ahead ? (int)last->at + 1 : (int)tip->at + corners, between, ahead ? 1 : -1,
                                        tip->layer))
            return 0;
    }
    return 1;
}

/* Fills tips, by layer and along the polygon; a place where the slit leaves it several times has as many. tips is room
   for two per segment, balance for one number per cap point. Returns their number. */
static int dgfemi_skin_find_tips(const dgfemi_skin_cutter *c, int *balance, dgfemi_tip *tips) {
    int clockwise = dgfemi_blade_is_clockwise(c->blade), count = 0;
    memset(balance, 0, (size_t)c->cap_count * sizeof(int));
    for (int i = 0; i < c->segments.count; i++)
        balance[c->segments.data[i].to]++, balance[c->segments.data[i].from]--;
    for (int i = 0; i < c->cap_count; i++) {
        dgfemi_tip tip;
        if (balance[i] == 0) continue;
        tip.cap = i, tip.layer = c->caps[i].layer, tip.leaves = balance[i] > 0 ? 1 : -1;
        tip.at = floor(dgfemi_blade_place(c->blade, clockwise, c->caps[i].world) * 1e6) / 1e6;
        for (int k = 0; k < balance[i] * tip.leaves; k++) tips[count++] = tip;
    }
    qsort(tips, (size_t)count, sizeof *tips, dgfemi_compare_tips);
    return count;
}

/* Where the polygon's boundary never meets the skin of a layer, the whole polygon lies inside or outside. met [layers]:
   1 for the others. 1 on success. */
static int dgfemi_skin_add_whole_polygons(dgfemi_skin_cutter *c, const char *met) {
    if (dgfemi_skin_section_winding(c, c->blade->polygon[0]) <= 0) return 1;
    for (int e = 0, next = 0; e < c->before->mesh->element_count; e++) {
        dgfem_vec3 rest;
        int element;
        if (c->layer[e] != next) continue; /* layers are numbered in the order of their first elements */
        if (!met[next] && dgfemi_skin_rest_of(c, c->blade->polygon[0], next, &rest, &element) <= DGFEM_R(1e-6) &&
            !dgfemi_skin_follow_polygon(c, DGFEM_NONE, DGFEM_NONE, 0, c->blade->polygon_count, 1, next))
            return 0;
        next++;
    }
    return 1;
}

/* Closes the slit along the polygon's boundary, inside each layer. 1 on success. */
static int dgfemi_skin_close_along_polygon(dgfemi_skin_cutter *c, dgfemi_arena *arena) {
    size_t tip_room = 2 * (size_t)c->segments.count;
    int *balance = (int *)dgfemi_arena_allocate(arena, (size_t)c->cap_count, sizeof *balance), count, end;
    char *met = (char *)dgfemi_arena_allocate_zero(arena, (size_t)c->layer_count, 1);
    dgfemi_tip *tips = (dgfemi_tip *)dgfemi_arena_allocate(arena, tip_room, sizeof *tips);
    const dgfemi_tip **open = (const dgfemi_tip **)dgfemi_arena_allocate(arena, tip_room, sizeof *open);
    if (!balance || !met || !tips || !open) return 0;
    count = dgfemi_skin_find_tips(c, balance, tips);
    for (int first = 0; first < count; first = end) {
        for (end = first + 1; end < count && tips[end].layer == tips[first].layer;) end++;
        if (tips[first].layer != DGFEM_NONE) met[tips[first].layer] = 1;
        dgfemi_order_tips(tips + first, end - first);
        if (!dgfemi_skin_join_tips(c, tips + first, end - first, open)) return 0;
    }
    return dgfemi_skin_add_whole_polygons(c, met);
}

/* Drops chains of segments that do not close: the skin has a border there. degree: two numbers for each cap point. */
static void dgfemi_skin_prune(dgfemi_skin_cutter *c, int *degree) {
    int dropped = 1;
    while (dropped) {
        int kept = 0;
        memset(degree, 0, 2 * (size_t)c->cap_count * sizeof(int));
        for (int i = 0; i < c->segments.count; i++)
            degree[2 * c->segments.data[i].from]++, degree[2 * c->segments.data[i].to + 1]++;
        for (int i = 0; i < c->segments.count; i++) {
            dgfemi_segment segment = c->segments.data[i];
            if (degree[2 * segment.to] == 0 || degree[2 * segment.from + 1] == 0) {
                degree[2 * segment.from]--, degree[2 * segment.to + 1]--;
                continue;
            }
            c->segments.data[kept++] = segment;
        }
        dropped = c->segments.count - kept;
        c->segments.count = kept;
    }
}

/* ---- triangles of the cross-section ---- */

/* Triangulates the region that `owner` bounds. 1 on success. */
static int dgfemi_skin_triangulate_region(dgfemi_skin_cutter *c, dgfemi_arena *arena, const dgfemi_joiner *joiner,
                                          int owner) {
    int loops = dgfemi_join_loop_count(joiner), loop_count = 0, count = 0, room;
    int *start = (int *)dgfemi_arena_allocate(arena, (size_t)loops + 1, sizeof(int));
    int *group = (int *)dgfemi_arena_allocate(arena, (size_t)loops, sizeof(int));
    int *vertices = (int *)dgfemi_arena_allocate(arena, (size_t)joiner->vertices.count, sizeof(int));
    dgfemi_planar planar;
    dgfemi_triangles list;
    if (!start || !group || !vertices) return 0;
    for (int l = 0; l < loops; l++) {
        int first = joiner->start.data[l], corners = joiner->start.data[l + 1] - first;
        if (joiner->owner.data[l] != owner || corners < 3) continue;
        start[loop_count++] = count;
        memcpy(vertices + count, joiner->vertices.data + first, (size_t)corners * sizeof(int));
        count += corners;
    }
    start[loop_count] = count;
    if (loop_count == 0) return 1;
    if (!dgfemi_planar_make(&planar, arena, joiner->mesh->vertices, vertices, start, loop_count, c->blade->normal))
        return 0;
    room = dgfemi_planar_triangle_count(&planar);
    list.data = (int *)dgfemi_arena_allocate(arena, 3 * (size_t)(room > 0 ? room : 1), sizeof(int));
    list.capacity = room, list.count = 0;
    if (!list.data) return 0;
    dgfemi_planar_triangulate(&planar, group, &list);
    for (int i = 0; i < 3 * list.count && i < 3 * room; i++)
        if (!dgfemi_push(c->hooks, &c->cap_triangles, list.data[i])) return 0;
    return 1;
}

/* Segments -> loops -> regions -> triangles. Loops that do not close get none. 1 on success. */
static int dgfemi_skin_triangulate(dgfemi_skin_cutter *c, dgfemi_arena *arena) {
    dgfem_mesh flat; /* the joiner looks at its vertices only */
    dgfemi_arena region = dgfemi_arena_make(c->hooks); /* one region's after another's */
    dgfemi_joiner joiner;
    dgfem_status status;
    int ok = 1;
    memset(&flat, 0, sizeof flat);
    memset(&joiner, 0, sizeof joiner);
    flat.hooks = *c->hooks, flat.hooks.log = NULL;
    flat.vertices = (dgfem_vec3 *)dgfemi_arena_allocate(arena, (size_t)c->cap_count, sizeof(dgfem_vec3));
    if (!flat.vertices) return 0;
    for (int i = 0; i < c->cap_count; i++) flat.vertices[i] = c->caps[i].world;
    flat.vertex_count = c->cap_count;
    joiner.mesh = &flat;
    joiner.label = (int *)dgfemi_arena_allocate(arena, (size_t)c->cap_count, sizeof(int));
    if (!joiner.label) return 0;
    for (int i = 0; i < c->cap_count; i++) joiner.label[i] = c->caps[i].layer;
    joiner.drop_open = 1;
    dgfemi_projection_axes(c->blade->normal, &joiner.axis_u, &joiner.axis_v);
    status = dgfemi_join_loops(&joiner, &c->segments);
    if (status == DGFEM_OK) status = dgfemi_join_regions(&joiner);
    for (int l = 0; ok && status == DGFEM_OK && l < dgfemi_join_loop_count(&joiner); l++) {
        if (joiner.owner.data[l] == l) ok = dgfemi_skin_triangulate_region(c, &region, &joiner, l);
        dgfemi_arena_reuse(&region);
    }
    dgfemi_arena_free(&region);
    dgfemi_joiner_free(&joiner);
    return ok && status != DGFEM_ERROR_MEMORY;
}

/* ---- refinement inside ---- */

/* Edges inside the cross-section longer than this times the elements' mean radius get a point in their middle, unless
   they are shorter than the edges of the boundary next to them. */
#define DGFEM_WALL_SPACING DGFEM_R(1.5)
#define DGFEM_WALL_ROUNDS 16
/* More points than this for each element, which a cross-section does not need, a slit that does not close may ask. */
#define DGFEM_WALL_POINTS 8

/* c->cap_triangles with neighbours: across the edge from corner k to the next one lies edge neighbour[3 t + k], written
   3 * triangle + corner, of the triangle there; DGFEM_NONE at the boundary. */
typedef struct dgfemi_wall_mesh {
    dgfemi_skin_cutter *cutter;
    dgfemi_ints neighbour;
    double (*flat)[2]; /* [cap points] */
    int flat_capacity;
} dgfemi_wall_mesh;

static int dgfemi_wall_next(int edge) { return edge - edge % 3 + (edge + 1) % 3; }
static int dgfemi_wall_before(int edge) { return edge - edge % 3 + (edge + 2) % 3; }

static dgfem_real dgfemi_wall_length(const dgfemi_wall_mesh *w, int edge) {
    const int *corners = w->cutter->cap_triangles.data;
    return dgfemi_distance(w->cutter->caps[corners[edge]].world,
                           w->cutter->caps[corners[dgfemi_wall_next(edge)]].world);
}

static void dgfemi_wall_link(dgfemi_wall_mesh *w, int edge, int other) {
    w->neighbour.data[edge] = other;
    if (other != DGFEM_NONE) w->neighbour.data[other] = edge;
}

/* Finds the neighbours. Edges of more than two triangles count as boundary. 1 on success. */
static int dgfemi_wall_link_all(dgfemi_wall_mesh *w) {
    const dgfem_hooks *hooks = w->cutter->hooks;
    const int *corners = w->cutter->cap_triangles.data;
    int count = w->cutter->cap_triangles.count, ok;
    dgfemi_buckets buckets;
    memset(&buckets, 0, sizeof buckets);
    ok = dgfemi_buckets_reset(hooks, &buckets, count);
    for (int i = 0; ok && i < count; i++) {
        int a = corners[i], b = corners[dgfemi_wall_next(i)], j;
        ok = dgfemi_push(hooks, &w->neighbour, DGFEM_NONE);
        if (!ok) break;
        for (j = dgfemi_buckets_first(&buckets, dgfemi_hash_pair(b, a)); j != DGFEM_NONE; j = buckets.next[j])
            if (corners[j] == b && corners[dgfemi_wall_next(j)] == a && w->neighbour.data[j] == DGFEM_NONE) break;
        if (j != DGFEM_NONE) dgfemi_wall_link(w, i, j);
        ok = dgfemi_buckets_insert(hooks, &buckets, i, dgfemi_hash_pair(a, b));
    }
    dgfemi_buckets_free(hooks, &buckets);
    return ok;
}

static int dgfemi_wall_turn(const dgfemi_wall_mesh *w, int a, int b, int c) {
    return dgfemi_orientation(w->flat[a], w->flat[b], w->flat[c]);
}

/* Whether the diagonal c-d of the quad a d b c is the better one: convex, and a-b fails Delaunay's test, the two angles
   that look at it being more than 180 degrees together. */
static int dgfemi_wall_should_flip(const dgfemi_wall_mesh *w, int a, int b, int c, int d) {
    const dgfemi_cap_point *p = w->cutter->caps;
    dgfem_vec3 ca = dgfemi_sub(p[a].world, p[c].world), cb = dgfemi_sub(p[b].world, p[c].world);
    dgfem_vec3 da = dgfemi_sub(p[a].world, p[d].world), db = dgfemi_sub(p[b].world, p[d].world);
    dgfem_real sine_c = dgfemi_norm(dgfemi_cross(ca, cb)), sine_d = dgfemi_norm(dgfemi_cross(da, db));
    dgfem_real cosine_c = dgfemi_dot(ca, cb), cosine_d = dgfemi_dot(da, db);
    dgfem_real size = dgfemi_norm(ca) * dgfemi_norm(cb) * dgfemi_norm(da) * dgfemi_norm(db);
    if (c == d || !(sine_c * cosine_d + cosine_c * sine_d < -64 * DGFEM_EPSILON * size)) return 0;
    return dgfemi_wall_turn(w, c, a, d) > 0 && dgfemi_wall_turn(w, d, b, c) > 0;
}

/*      c                c
       / \              /|\        edge a-b of the triangle a b c, whose neighbour is b a d:
      a---b     ->     a | b       triangles become a d c and d b c
       \ /              \|/
        d                d        */
static void dgfemi_wall_flip(dgfemi_wall_mesh *w, int edge) {
    int *corners = w->cutter->cap_triangles.data, *neighbour = w->neighbour.data;
    int other = neighbour[edge], t[3], s[3], outer[4];
    t[0] = edge, t[1] = dgfemi_wall_next(edge), t[2] = dgfemi_wall_before(edge);
    s[0] = other, s[1] = dgfemi_wall_next(other), s[2] = dgfemi_wall_before(other);
    outer[0] = neighbour[t[1]], outer[1] = neighbour[t[2]], outer[2] = neighbour[s[1]], outer[3] = neighbour[s[2]];
    /* t: a b c -> a d c, s: b a d -> d b c, as corners 0, 1, 2 from the flipped edge's place on */
    corners[t[1]] = corners[s[2]];
    corners[s[1]] = corners[s[0]], corners[s[0]] = corners[s[2]], corners[s[2]] = corners[t[2]];
    dgfemi_wall_link(w, t[0], outer[2]); /* a-d */
    dgfemi_wall_link(w, t[1], s[2]);     /* d-c */
    dgfemi_wall_link(w, t[2], outer[1]); /* c-a */
    dgfemi_wall_link(w, s[0], outer[3]); /* d-b */
    dgfemi_wall_link(w, s[1], outer[0]); /* b-c */
}

/* Flips until all is Delaunay, or for long enough. */
static void dgfemi_wall_flip_all(dgfemi_wall_mesh *w) {
    for (int round = 0; round < 64; round++) {
        int flipped = 0;
        for (int i = 0; i < w->cutter->cap_triangles.count; i++) {
            const int *corners = w->cutter->cap_triangles.data;
            int other = w->neighbour.data[i];
            if (other < i) continue; /* each edge once, and not the boundary */
            if (!dgfemi_wall_should_flip(w, corners[i], corners[other], corners[dgfemi_wall_before(i)],
                                         corners[dgfemi_wall_before(other)]))
                continue;
            dgfemi_wall_flip(w, i);
            flipped++;
        }
        if (!flipped) return;
    }
}

/* Whether an edge is long enough for a point in its middle. */
static int dgfemi_wall_is_long(const dgfemi_wall_mesh *w, int edge, dgfem_real spacing) {
    dgfem_real length = dgfemi_wall_length(w, edge);
    int around[4];
    if (!(length > spacing)) return 0;
    around[0] = dgfemi_wall_next(edge), around[1] = dgfemi_wall_before(edge);
    around[2] = dgfemi_wall_next(w->neighbour.data[edge]), around[3] = dgfemi_wall_before(w->neighbour.data[edge]);
    for (int k = 0; k < 4; k++)
        if (w->neighbour.data[around[k]] == DGFEM_NONE && dgfemi_wall_length(w, around[k]) > length) return 0;
    return 1;
}

/*      c                c
       / \              /|\        a new point m: a m c stays in place of a b c, m a d of b a d;
      a---b     ->     a-m-b       m b c and b m d are new
       \ /              \|/
        d                d        */
static int dgfemi_wall_divide(dgfemi_wall_mesh *w, int edge) {
    dgfemi_skin_cutter *c = w->cutter;
    int other = w->neighbour.data[edge], t1 = dgfemi_wall_next(edge), s2 = dgfemi_wall_before(other), new_t, new_s, m;
    int a = c->cap_triangles.data[edge], b = c->cap_triangles.data[other], outer_t = w->neighbour.data[t1],
        outer_s = w->neighbour.data[s2], t[6];
    m = dgfemi_skin_add_cap(c, DGFEM_NONE, a, b,
                            dgfemi_scale(DGFEM_R(0.5), dgfemi_add(c->caps[a].world, c->caps[b].world)),
                            dgfemi_scale(DGFEM_R(0.5), dgfemi_add(c->caps[a].rest, c->caps[b].rest)),
                            c->caps[a].element, c->caps[a].layer);
    if (m == DGFEM_NONE) return 0;
    if (m >= w->flat_capacity) {
        void *grown = dgfemi_grow(c->hooks, w->flat, &w->flat_capacity, m + 1, sizeof *w->flat);
        if (!grown) return 0;
        w->flat = (double(*)[2])grown;
    }
    dgfemi_blade_project(c->blade, c->caps[m].world, w->flat[m]);
    new_t = c->cap_triangles.count, new_s = new_t + 3;
    t[0] = m, t[1] = b, t[2] = c->cap_triangles.data[dgfemi_wall_before(edge)];
    t[3] = b, t[4] = m, t[5] = c->cap_triangles.data[s2];
    for (int k = 0; k < 6; k++)
        if (!dgfemi_push(c->hooks, &c->cap_triangles, t[k]) || !dgfemi_push(c->hooks, &w->neighbour, DGFEM_NONE))
            return 0;
    c->cap_triangles.data[t1] = m, c->cap_triangles.data[other] = m;
    dgfemi_wall_link(w, new_t, new_s);       /* m-b */
    dgfemi_wall_link(w, new_t + 1, outer_t); /* b-c */
    dgfemi_wall_link(w, new_t + 2, t1);      /* c-m */
    dgfemi_wall_link(w, new_s + 1, s2);      /* m-d */
    dgfemi_wall_link(w, new_s + 2, outer_s); /* d-b */
    return 1;
}

/* Points inside large walls, so that they can bend. 1 on success. */
static int dgfemi_skin_refine_caps(dgfemi_skin_cutter *c) {
    dgfem_real spacing = DGFEM_WALL_SPACING * dgfemi_skin_mean_radius(c->body->mesh);
    dgfemi_wall_mesh w;
    int ok, most = c->cap_count + DGFEM_WALL_POINTS * c->body->mesh->element_count;
    memset(&w, 0, sizeof w);
    w.cutter = c;
    w.flat_capacity = c->cap_count;
    w.flat = (double(*)[2])dgfemi_allocate(c->hooks, (size_t)c->cap_count, sizeof *w.flat);
    ok = w.flat != NULL;
    for (int i = 0; ok && i < c->cap_count; i++) dgfemi_blade_project(c->blade, c->caps[i].world, w.flat[i]);
    ok = ok && dgfemi_wall_link_all(&w);
    for (int round = 0; ok && round < DGFEM_WALL_ROUNDS; round++) {
        int count = c->cap_triangles.count, divided = 0;
        dgfemi_wall_flip_all(&w);
        for (int i = 0; ok && i < count && c->cap_count < most; i++) {
            if (w.neighbour.data[i] == DGFEM_NONE || !dgfemi_wall_is_long(&w, i, spacing)) continue;
            ok = dgfemi_wall_divide(&w, i);
            divided = 1;
        }
        if (!divided) break;
    }
    dgfemi_free(c->hooks, w.neighbour.data);
    dgfemi_free(c->hooks, w.flat);
    return ok;
}

/* The triangles of the cross-section inside the blade. 1 on success. */
static int dgfemi_skin_find_caps(dgfemi_skin_cutter *c) {
    dgfemi_arena arena = dgfemi_arena_make(c->hooks);
    int ok = dgfemi_skin_find_segments(c) && dgfemi_skin_find_cap_layers(c);
    if (ok && c->blade->polygon) ok = dgfemi_skin_close_along_polygon(c, &arena);
    if (ok && c->segments.count > 0) {
        int *degree = (int *)dgfemi_arena_allocate(&arena, 2 * (size_t)c->cap_count, sizeof(int));
        ok = degree != NULL;
        if (ok) dgfemi_skin_prune(c, degree);
    }
    if (ok && c->segments.count > 0) ok = dgfemi_skin_triangulate(c, &arena) && dgfemi_skin_refine_caps(c);
    dgfemi_arena_free(&arena);
    return ok;
}
