#pragma once
#include "split.c"
/* Cuts: faces on a blade come apart.

   A blade is a plane, or a polygon in it. The elements that it meets are split along the whole plane; what lies on the
   plane, between an element above and one below, is divided along the sides of the polygon, and comes apart inside. A
   node gets as many copies as it has groups of elements that hang together around it by faces that are whole: so nodes
   inside are doubled, those on the front of the cut are not, and crossing cuts make three or four. */

typedef struct dgfem_mvci_points {
    double (*at)[2];
    int count, capacity;
} dgfem_mvci_points;

/* A polygon without corners is the whole plane. */
typedef struct dgfem_mvci_blade {
    dgfem_plane plane;         /* unit normal */
    dgfem_vec3 origin, u, v;   /* of the plane's coordinates */
    int single, element;       /* single: only this element is split */
    dgfem_mvci_points polygon; /* counter-clockwise, without crossings */
    dgfem_mvci_points hull, clip, other;
} dgfem_mvci_blade;

typedef struct dgfem_mvci_cracks {
    dgfem_mvci_ints faces;                 /* that come apart */
    dgfem_mvci_ints number;                /* [nodes] position in `nodes`, or DGFEM_NONE */
    dgfem_mvci_ints nodes;                 /* of the faces */
    dgfem_mvci_ints pair_node, root, copy; /* of (node, element) */
    dgfem_mvci_ints groups;                /* [nodes of faces] groups of elements */
    dgfem_mvci_ints region;                /* [nodes of faces] connected by faces */
    dgfem_mvci_ints cut;                   /* [faces] 1: comes apart */
    dgfem_mvci_edges pairs, surface;
    dgfem_mvci_levels levels; /* of lines in the plane */
    int nodes_copied;
} dgfem_mvci_cracks;

static void dgfem_mvci_blade_free(const dgfem_hooks *hooks, dgfem_mvci_blade *blade) {
    dgfem_mvci_free(hooks, blade->polygon.at);
    dgfem_mvci_free(hooks, blade->hull.at);
    dgfem_mvci_free(hooks, blade->clip.at);
    dgfem_mvci_free(hooks, blade->other.at);
}

static void dgfem_mvci_cracks_free(const dgfem_hooks *hooks, dgfem_mvci_cracks *c) {
    dgfem_mvci_free(hooks, c->faces.data);
    dgfem_mvci_free(hooks, c->number.data);
    dgfem_mvci_free(hooks, c->nodes.data);
    dgfem_mvci_free(hooks, c->pair_node.data);
    dgfem_mvci_free(hooks, c->root.data);
    dgfem_mvci_free(hooks, c->copy.data);
    dgfem_mvci_free(hooks, c->groups.data);
    dgfem_mvci_free(hooks, c->region.data);
    dgfem_mvci_free(hooks, c->cut.data);
    dgfem_mvci_free(hooks, c->pairs.slots);
    dgfem_mvci_free(hooks, c->surface.slots);
    dgfem_mvci_levels_free(hooks, &c->levels);
}

/* ---- in the plane ---- */

static int dgfem_mvci_points_push(const dgfem_hooks *hooks, dgfem_mvci_points *points, double x, double y) {
    void *data = points->at;
    int ok = dgfem_mvci_room(hooks, &data, points->count, &points->capacity, 1, sizeof *points->at);
    points->at = (double(*)[2])data;
    if (!ok) return 0;
    points->at[points->count][0] = x, points->at[points->count][1] = y;
    points->count++;
    return 1;
}

static void dgfem_mvci_blade_place(const dgfem_mvci_blade *blade, dgfem_vec3 x, double out[2]) {
    dgfem_vec3 d = dgfem_mvci_sub(x, blade->origin);
    out[0] = (double)dgfem_mvci_dot(d, blade->u);
    out[1] = (double)dgfem_mvci_dot(d, blade->v);
}

static double dgfem_mvci_points_area(const dgfem_mvci_points *points) {
    double area = 0;
    for (int i = 2; i < points->count; i++)
        area += dgfem_mvci_turn(points->at[0], points->at[i - 1], points->at[i]) / 2;
    return area;
}

/* Replaces points by the corners of their convex hull, counter-clockwise; `stack` is room. */
static int dgfem_mvci_points_hull(const dgfem_hooks *hooks, dgfem_mvci_points *points, dgfem_mvci_points *stack) {
    for (int i = 1; i < points->count; i++) { /* sorted by x, then y */
        double x = points->at[i][0], y = points->at[i][1];
        int j = i;
        for (; j > 0 && (points->at[j - 1][0] > x || (points->at[j - 1][0] == x && points->at[j - 1][1] > y)); j--)
            memcpy(points->at[j], points->at[j - 1], sizeof *points->at);
        points->at[j][0] = x, points->at[j][1] = y;
    }
    stack->count = 0;
    for (int pass = 0; pass < 2; pass++) {
        int base = stack->count;
        for (int k = 0; k < points->count; k++) {
            const double *p = points->at[pass ? points->count - 1 - k : k];
            while (stack->count >= base + 2 &&
                   dgfem_mvci_turn(stack->at[stack->count - 2], stack->at[stack->count - 1], p) <= 0)
                stack->count--;
            if (!dgfem_mvci_points_push(hooks, stack, p[0], p[1])) return 0;
        }
        if (stack->count) stack->count--; /* the other pass begins with it */
    }
    dgfem_mvci_points swap = *points;
    *points = *stack;
    *stack = swap;
    return 1;
}

/* Area of the blade's polygon inside blade->hull. Negative when out of memory. */
static double dgfem_mvci_overlap(const dgfem_hooks *hooks, dgfem_mvci_blade *blade) {
    blade->clip.count = 0;
    for (int i = 0; i < blade->polygon.count; i++)
        if (!dgfem_mvci_points_push(hooks, &blade->clip, blade->polygon.at[i][0], blade->polygon.at[i][1])) return -1;
    for (int k = 0; k < blade->hull.count; k++) {
        const double *a = blade->hull.at[k], *b = blade->hull.at[(k + 1) % blade->hull.count];
        blade->other.count = 0;
        for (int i = 0; i < blade->clip.count; i++) {
            const double *p = blade->clip.at[i], *q = blade->clip.at[(i + 1) % blade->clip.count];
            double dp = dgfem_mvci_turn(a, b, p), dq = dgfem_mvci_turn(a, b, q);
            if (dp >= 0 && !dgfem_mvci_points_push(hooks, &blade->other, p[0], p[1])) return -1;
            if ((dp > 0 && dq < 0) || (dp < 0 && dq > 0)) {
                double t = dp / (dp - dq);
                if (!dgfem_mvci_points_push(hooks, &blade->other, p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
                    return -1;
            }
        }
        dgfem_mvci_points swap = blade->clip;
        blade->clip = blade->other;
        blade->other = swap;
    }
    return fabs(dgfem_mvci_points_area(&blade->clip));
}

static int dgfem_mvci_inside(const dgfem_mvci_points *polygon, const double *p) {
    int inside = 0;
    for (int i = 0; i < polygon->count; i++) {
        const double *a = polygon->at[i], *b = polygon->at[(i + 1) % polygon->count];
        if ((a[1] > p[1]) == (b[1] > p[1])) continue;
        if (p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])) inside = !inside;
    }
    return inside;
}

/* Distance of a point from the sides of a polygon. */
static double dgfem_mvci_side_distance(const dgfem_mvci_points *polygon, const double *p) {
    double least = HUGE_VAL;
    for (int i = 0; i < polygon->count; i++) {
        const double *a = polygon->at[i], *b = polygon->at[(i + 1) % polygon->count];
        double square = dgfem_mvci_square(a, b), q[2];
        double t = square > 0 ? ((p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])) / square : 0;
        t = t < 0 ? 0 : t > 1 ? 1 : t;
        for (int k = 0; k < 2; k++) q[k] = a[k] + t * (b[k] - a[k]);
        double distance = sqrt(dgfem_mvci_square(p, q));
        if (distance < least) least = distance;
    }
    return least;
}

/* ---- which elements a blade meets ---- */

/* The blade's plane in an element, from the crossings of its edges, becomes blade->hull. */
static int dgfem_mvci_section(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int element,
                              dgfem_mvci_blade *blade) {
    const dgfem_vec3 *x = dgfem_mvci_blade_space(s, mesh);
    int face_count;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    blade->hull.count = 0;
    for (int k = 0; k < face_count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++) {
            int a = loop[i], b = loop[(i + 1) % count];
            dgfem_real va = s->levels.value[a], vb = s->levels.value[b];
            double p[2];
            if (!(va == 0 || (va > 0 && vb < 0) || (va < 0 && vb > 0))) continue;
            dgfem_real t = va == 0 ? 0 : va / (va - vb);
            dgfem_mvci_blade_place(blade, dgfem_mvci_axpy(x[a], t, dgfem_mvci_sub(x[b], x[a])), p);
            if (!dgfem_mvci_points_push(s->hooks, &blade->hull, p[0], p[1])) return 0;
        }
    }
    return dgfem_mvci_points_hull(s->hooks, &blade->hull, &blade->other);
}

/* Smaller parts of an area are taken for none. */
static double dgfem_mvci_least_area(void) { return DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-6; }

/* Levels of all nodes; s->selected: elements that the blade passes; s->elements_kept: others that it passes but that
   have to stay whole. 0 when out of memory. */
static int dgfem_mvci_select(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade) {
    s->selected.count = s->elements_kept = 0;
    if (!dgfem_mvci_measure_levels(s, mesh)) return 0;
    for (int e = 0; e < mesh->element_count; e++) {
        if (blade->single && e != blade->element) continue;
        if (!dgfem_mvci_element_straddles(mesh, e, &s->levels)) continue;
        if (blade->polygon.count) {
            if (!dgfem_mvci_section(s, mesh, e, blade)) return 0;
            double whole = dgfem_mvci_points_area(&blade->hull), part = dgfem_mvci_overlap(s->hooks, blade);
            if (part < 0) return 0;
            if (!(part > dgfem_mvci_least_area() * whole)) continue;
        }
        if (dgfem_mvci_stays_whole(s, e)) s->elements_kept++;
        else if (!dgfem_mvci_push(s->hooks, &s->selected, e)) return 0;
    }
    return 1;
}

/* ---- faces on the blade ---- */

/* Which side of the blade the element of a face on the blade is on (1 above, -1 below). One that is on both, elsewhere,
   is on the side that the face looks away from; 0 where the face does not lie along the blade. */
static int dgfem_mvci_element_side(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int face, int side) {
    int face_count, above = 0, below = 0, count;
    const int *faces = dgfem_mvci_element_faces(mesh, mesh->faces[face].owner[side], &face_count);
    dgfem_real sum = 0;
    for (int k = 0; k < face_count; k++) {
        const int *loop = dgfem_mvci_face_loop(mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++) {
            above |= s->levels.sign[loop[i]] > 0, below |= s->levels.sign[loop[i]] < 0;
            sum += s->levels.value[loop[i]];
        }
    }
    if (above != below) return above - below;
    if (!above) return sum > 0 ? 1 : -1; /* flat on the blade */
    const int *loop = dgfem_mvci_face_loop(mesh, face, &count);
    dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(dgfem_mvci_blade_space(s, mesh), loop, count));
    dgfem_real up = dgfem_mvci_dot(normal, s->plane.normal);
    if (dgfem_mvci_abs(up) < DGFEM_R(0.5)) return 0;
    return (up > 0) == !side ? -1 : 1;
}

/* c->faces: those between an element above and one below. 0 when out of memory. */
static int dgfem_mvci_find_blade_faces(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh,
                                       dgfem_mvci_cracks *c) {
    c->faces.count = 0;
    for (int f = 0; f < mesh->face_count; f++) {
        int count, on = 1;
        const int *loop = dgfem_mvci_face_loop(mesh, f, &count), *owner = mesh->faces[f].owner;
        if (owner[0] == DGFEM_NONE || owner[1] == DGFEM_NONE) continue;
        for (int i = 0; i < count && on; i++) on = s->levels.sign[loop[i]] == 0;
        if (!on) continue;
        if (dgfem_mvci_element_side(s, mesh, f, 0) * dgfem_mvci_element_side(s, mesh, f, 1) >= 0) continue;
        if (!dgfem_mvci_push(s->hooks, &c->faces, f)) return 0;
    }
    return 1;
}

/* Length of the part of a segment that lies in a convex face, relative to the face. */
static double dgfem_mvci_segment_in_face(const dgfem_mvci_blade *blade, const dgfem_vec3 *x, const int *loop, int count,
                                         const double *a, const double *b) {
    double low = 0, high = 1, area = 0, size = 0, p[2], q[2], start[2];
    dgfem_mvci_blade_place(blade, x[loop[0]], start);
    for (int i = 0; i < count; i++) {
        dgfem_mvci_blade_place(blade, x[loop[i]], p);
        dgfem_mvci_blade_place(blade, x[loop[(i + 1) % count]], q);
        area += dgfem_mvci_turn(start, p, q);
        size += sqrt(dgfem_mvci_square(p, q));
    }
    for (int i = 0; i < count; i++) {
        dgfem_mvci_blade_place(blade, x[loop[i]], p);
        dgfem_mvci_blade_place(blade, x[loop[(i + 1) % count]], q);
        double da = dgfem_mvci_turn(p, q, a), db = dgfem_mvci_turn(p, q, b);
        double length = sqrt(dgfem_mvci_square(p, q)), none = 1e-9 * size * length;
        if (area < 0) da = -da, db = -db;
        if (da <= none && db <= none) return 0;
        if (da < 0 && db > 0 && da / (da - db) > low) low = da / (da - db);
        if (da > 0 && db < 0 && da / (da - db) < high) high = da / (da - db);
    }
    return high > low ? (high - low) * sqrt(dgfem_mvci_square(a, b)) / size : 0;
}

/* Distances from the line through a and b, positive on its left, of the nodes of a face. */
static int dgfem_mvci_line_levels(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh,
                                  const dgfem_mvci_blade *blade, dgfem_mvci_cracks *c, int face, const double *a,
                                  const double *b) {
    const dgfem_vec3 *x = dgfem_mvci_blade_space(s, mesh);
    int count;
    const int *loop = dgfem_mvci_face_loop(mesh, face, &count);
    double length = sqrt(dgfem_mvci_square(a, b));
    if (!dgfem_mvci_levels_room(s->hooks, &c->levels, mesh->node_count)) return 0;
    for (int i = 0; i < count; i++) {
        double p[2], distance;
        dgfem_mvci_blade_place(blade, x[loop[i]], p);
        distance = dgfem_mvci_turn(a, b, p) / length;
        if (fabs(distance) <= 64 * (double)DGFEM_MVC_EPSILON * (fabs(p[0]) + fabs(p[1]) + length)) distance = 0;
        c->levels.value[loop[i]] = (dgfem_real)distance;
        c->levels.sign[loop[i]] = (signed char)dgfem_mvci_sign((dgfem_real)distance);
    }
    return 1;
}

/* Divides the faces of c->faces that a side of the polygon crosses, by its whole line; the new parts are appended. 0
   when out of memory. */
static int dgfem_mvci_divide_along(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade,
                                   dgfem_mvci_cracks *c, const double *a, const double *b) {
    int before = c->faces.count, corners = 0;
    s->list.count = 0;
    for (int k = 0; k < before; k++) {
        int f = c->faces.data[k], count, keep = 0;
        const int *loop = dgfem_mvci_face_loop(mesh, f, &count);
        for (int side = 0; side < 2; side++) keep |= dgfem_mvci_stays_whole(s, mesh->faces[f].owner[side]);
        if (keep || !(dgfem_mvci_segment_in_face(blade, dgfem_mvci_blade_space(s, mesh), loop, count, a, b) > 1e-6))
            continue;
        corners += count;
        if (!dgfem_mvci_push(s->hooks, &s->list, f) || !dgfem_mvci_line_levels(s, mesh, blade, c, f, a, b)) return 0;
    }
    for (int k = 0; k < s->list.count; k++) dgfem_mvci_snap_face(s, mesh, s->list.data[k], &c->levels);
    for (int changed = 1; changed;) {
        changed = 0;
        for (int k = 0; k < s->list.count; k++)
            changed |= dgfem_mvci_snap_between(s, mesh, s->list.data[k], &c->levels);
    }
    if (!dgfem_mvci_edges_reset(s->hooks, &s->crossings, corners)) return 0;
    for (int k = 0; k < s->list.count; k++)
        if (dgfem_mvci_face_changes(mesh, s->list.data[k], &c->levels) == 2 &&
            !dgfem_mvci_cross_face(s, mesh, &c->levels, s->list.data[k]))
            return 0;
    if (!dgfem_mvci_insert_nodes(s, mesh)) return 0;
    for (int k = 0; k < s->list.count; k++) {
        if (dgfem_mvci_face_changes(mesh, s->list.data[k], &c->levels) != 2) continue;
        int part = dgfem_mvci_split_face(s, mesh, s->list.data[k], &c->levels);
        if (part == DGFEM_NONE) return 0;
        if (part != s->list.data[k] && !dgfem_mvci_push(s->hooks, &c->faces, part)) return 0;
    }
    return dgfem_mvci_levels_room(s->hooks, &s->levels, mesh->node_count);
}

static double dgfem_mvci_longest_edge(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh,
                                      const dgfem_mvci_cracks *c) {
    const dgfem_vec3 *x = dgfem_mvci_blade_space(s, mesh);
    double longest = 0;
    for (int k = 0; k < c->faces.count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, c->faces.data[k], &count);
        for (int i = 0; i < count; i++)
            longest = fmax(longest, (double)dgfem_mvci_distance(x[loop[i]], x[loop[(i + 1) % count]]));
    }
    return longest;
}

/* Keeps in c->faces what lies inside of the polygon, or so little outside that snapping may have put it there: else
   polygons with a side in common would leave slivers whole between them. */
static void dgfem_mvci_keep_inside(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh,
                                   const dgfem_mvci_blade *blade, dgfem_mvci_cracks *c) {
    const dgfem_vec3 *x = dgfem_mvci_blade_space(s, mesh);
    double near = (double)s->snap / 2 * dgfem_mvci_longest_edge(s, mesh, c);
    int kept = 0;
    for (int k = 0; k < c->faces.count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, c->faces.data[k], &count);
        double start[2], p[2], q[2], centre[2] = {0, 0}, area = 0;
        dgfem_mvci_blade_place(blade, x[loop[0]], start);
        for (int i = 2; i < count; i++) {
            dgfem_mvci_blade_place(blade, x[loop[i - 1]], p);
            dgfem_mvci_blade_place(blade, x[loop[i]], q);
            double part = dgfem_mvci_turn(start, p, q);
            area += part;
            for (int j = 0; j < 2; j++) centre[j] += part * (p[j] + q[j] - 2 * start[j]) / 3;
        }
        if (area == 0) continue;
        for (int j = 0; j < 2; j++) centre[j] = start[j] + centre[j] / area;
        if (dgfem_mvci_inside(&blade->polygon, centre) || dgfem_mvci_side_distance(&blade->polygon, centre) <= near)
            c->faces.data[kept++] = c->faces.data[k];
    }
    c->faces.count = kept;
}

/* ---- what hangs together around a node ---- */

/* Fills `ints` with `count` times `value`. 0 when out of memory. */
static int dgfem_mvci_fill(const dgfem_hooks *hooks, dgfem_mvci_ints *ints, int count, int value) {
    ints->count = 0;
    if (!dgfem_mvci_ints_room(hooks, ints, count)) return 0;
    while (ints->count < count) ints->data[ints->count++] = value;
    return 1;
}

/* The nodes of c->faces, and their regions. 0 when out of memory. */
static int dgfem_mvci_number_crack(const dgfem_hooks *hooks, const dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c) {
    c->nodes.count = c->region.count = 0;
    if (!dgfem_mvci_fill(hooks, &c->number, mesh->node_count, DGFEM_NONE) ||
        !dgfem_mvci_fill(hooks, &c->cut, mesh->face_count, 0))
        return 0;
    for (int k = 0; k < c->faces.count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, c->faces.data[k], &count);
        c->cut.data[c->faces.data[k]] = 1;
        for (int i = 0; i < count; i++) {
            if (c->number.data[loop[i]] == DGFEM_NONE) {
                c->number.data[loop[i]] = c->nodes.count;
                if (!dgfem_mvci_push(hooks, &c->region, c->nodes.count) || !dgfem_mvci_push(hooks, &c->nodes, loop[i]))
                    return 0;
            }
            if (i) dgfem_mvci_join(c->region.data, c->number.data[loop[0]], c->number.data[loop[i]]);
        }
    }
    return 1;
}

/* The (node, element) of a node of the crack; made where it is not there. DGFEM_NONE when out of memory. */
static int dgfem_mvci_pair(const dgfem_hooks *hooks, dgfem_mvci_cracks *c, int node, int element) {
    dgfem_mvci_edge *pair = dgfem_mvci_edges_at(&c->pairs, node, element);
    if (pair->value != DGFEM_NONE) return pair->value;
    if (!dgfem_mvci_push(hooks, &c->pair_node, node) || !dgfem_mvci_push(hooks, &c->root, c->root.count))
        return DGFEM_NONE;
    return pair->value = c->root.count - 1;
}

/* c->groups: number of groups of elements at each node of the crack; c->surface: edges of the boundary between such
   nodes. 0 when out of memory. */
static int dgfem_mvci_group_elements(const dgfem_hooks *hooks, const dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c) {
    int uses = 0;
    c->pair_node.count = c->root.count = 0;
    for (int f = 0; f < mesh->face_count; f++)
        for (int i = 0; i < mesh->faces[f].count && mesh->faces[f].owner[0] != DGFEM_NONE; i++)
            uses += c->number.data[mesh->loops.data[mesh->faces[f].loop + i]] != DGFEM_NONE;
    if (!dgfem_mvci_edges_reset(hooks, &c->pairs, 2 * uses) || !dgfem_mvci_edges_reset(hooks, &c->surface, uses) ||
        !dgfem_mvci_fill(hooks, &c->groups, c->nodes.count, 0))
        return 0;
    for (int f = 0; f < mesh->face_count; f++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, f, &count), *owner = mesh->faces[f].owner;
        for (int i = 0; i < count && owner[0] != DGFEM_NONE; i++) {
            int next = loop[(i + 1) % count];
            if (c->number.data[loop[i]] == DGFEM_NONE) continue;
            int a = dgfem_mvci_pair(hooks, c, loop[i], owner[0]), b = a;
            if (owner[1] != DGFEM_NONE) b = dgfem_mvci_pair(hooks, c, loop[i], owner[1]);
            if (a == DGFEM_NONE || b == DGFEM_NONE) return 0;
            if (!c->cut.data[f]) dgfem_mvci_join(c->root.data, a, b);
            if (owner[1] == DGFEM_NONE && c->number.data[next] != DGFEM_NONE)
                dgfem_mvci_edges_between(&c->surface, loop[i], next)->value = 1;
        }
    }
    for (int p = 0; p < c->root.count; p++)
        if (c->root.data[p] == p) c->groups.data[c->number.data[c->pair_node.data[p]]]++;
    return 1;
}

/* ---- cuts that could not open ---- */

/* Nodes in the middle of edges at which a cut meets the surface, where both ends hang together. Returns their number,
   -1 when out of memory. */
static int dgfem_mvci_open_mouths(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c) {
    int corners = 0, made = 0;
    for (int k = 0; k < c->faces.count; k++) corners += mesh->faces[c->faces.data[k]].count;
    if (!dgfem_mvci_edges_reset(s->hooks, &s->crossings, corners)) return -1;
    for (int k = 0; k < c->faces.count; k++)
        for (int i = 0; i < mesh->faces[c->faces.data[k]].count; i++) {
            const dgfem_mvci_face *face = &mesh->faces[c->faces.data[k]];
            int a = mesh->loops.data[face->loop + i], b = mesh->loops.data[face->loop + (i + 1) % face->count];
            if (c->groups.data[c->number.data[a]] > 1 || c->groups.data[c->number.data[b]] > 1) continue;
            if (dgfem_mvci_edges_find_between(&c->surface, a, b) == DGFEM_NONE) continue;
            if (dgfem_mvci_edge_is_sealed(s, a, b)) continue;
            dgfem_mvci_edge *edge = dgfem_mvci_edges_between(&s->crossings, a, b);
            if (edge->value != DGFEM_NONE) continue;
            edge->value = dgfem_mvci_add_node_between(mesh, edge->a, edge->b, DGFEM_R(0.5));
            if (edge->value == DGFEM_NONE) return -1;
            made++;
        }
    if (made && !dgfem_mvci_insert_nodes(s, mesh)) return -1;
    s->nodes_added += made;
    return made;
}

/* The triangle of a face that has its centroid, and the centroid's coordinates in it. */
static void dgfem_mvci_face_centre(const dgfem_mvci_mesh *mesh, int face, int nodes[3], dgfem_real weights[3]) {
    int count, best = 0;
    const int *triangles = dgfem_mvci_face_triangles(mesh, face, &count);
    dgfem_vec3 normal =
        dgfem_mvci_loop_area(mesh->rest, mesh->loops.data + mesh->faces[face].loop, mesh->faces[face].count);
    dgfem_vec3 centre = dgfem_mvci_vec3(0, 0, 0);
    dgfem_real total = 0, best_least = 0;
    for (int t = 0; t < count; t++) {
        dgfem_real area = dgfem_mvci_dot(dgfem_mvci_loop_area(mesh->rest, triangles + 3 * t, 3), normal);
        total += area;
        for (int i = 0; i < 3; i++) centre = dgfem_mvci_axpy(centre, area / 3, mesh->rest[triangles[3 * t + i]]);
    }
    centre = dgfem_mvci_scale(1 / total, centre);
    for (int t = 0; t < count; t++) {
        dgfem_real w[3], sum = 0, least;
        for (int i = 0; i < 3; i++) {
            dgfem_vec3 a = dgfem_mvci_sub(mesh->rest[triangles[3 * t + (i + 1) % 3]], centre);
            dgfem_vec3 b = dgfem_mvci_sub(mesh->rest[triangles[3 * t + (i + 2) % 3]], centre);
            sum += w[i] = dgfem_mvci_dot(dgfem_mvci_cross(a, b), normal);
        }
        least = (w[0] < w[1] ? w[0] : w[1]) / sum;
        if (w[2] / sum < least) least = w[2] / sum;
        if (t && least <= best_least) continue;
        best = t, best_least = least;
        for (int i = 0; i < 3; i++) weights[i] = w[i] / sum;
    }
    for (int i = 0; i < 3; i++) nodes[i] = triangles[3 * best + i];
}

/* A node at the centroid of a face, which is divided into triangles around it, all cut. 0 when out of memory. */
static int dgfem_mvci_fan(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c, int face) {
    dgfem_mvci_face old = mesh->faces[face];
    int nodes[3], loop[3];
    dgfem_real weights[3];
    dgfem_mvci_face_centre(mesh, face, nodes, weights);
    int centre = dgfem_mvci_add_node(mesh, nodes, weights, 3);
    if (centre == DGFEM_NONE) return 0;
    s->nodes_added++;
    s->buffer.count = 0;
    if (dgfem_mvci_append(s->hooks, &s->buffer, mesh->loops.data + old.loop, old.count) == DGFEM_NONE) return 0;
    for (int i = 0; i < old.count; i++) {
        loop[0] = centre, loop[1] = s->buffer.data[i], loop[2] = s->buffer.data[(i + 1) % old.count];
        if (!i) {
            if (!dgfem_mvci_set_loop(mesh, face, loop, 3)) return 0;
            continue;
        }
        int index = dgfem_mvci_add_face(mesh, old.owner[0], old.owner[1], loop, 3, old.from, old.wall);
        if (index == DGFEM_NONE || !dgfem_mvci_push(s->hooks, &c->faces, index)) return 0;
        for (int side = 0; side < 2; side++)
            if (!dgfem_mvci_add_element_face(mesh, old.owner[side], index, side)) return 0;
    }
    return 1;
}

/* Takes the first `faces` of c->faces that are in a region from the list. Returns how many of the first remain. */
static int dgfem_mvci_leave_region(const dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c, int region, int faces) {
    int kept = 0, left = faces;
    for (int k = 0; k < c->faces.count; k++) {
        int first = mesh->loops.data[mesh->faces[c->faces.data[k]].loop];
        if (k < faces && first < c->number.count && dgfem_mvci_root(c->region.data, c->number.data[first]) == region)
            left--;
        else c->faces.data[kept++] = c->faces.data[k];
    }
    c->faces.count = kept;
    return left;
}

/* In each region none of whose nodes has two groups, a node in the largest face that no sealed element has; a region
   without such a face does not come apart. Returns the number of nodes, -1 when out of memory. */
static int dgfem_mvci_open_pockets(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c) {
    int made = 0, faces = c->faces.count;
    for (int n = 0; n < c->nodes.count; n++) {
        int open = 0, best = DGFEM_NONE;
        dgfem_real largest = 0;
        if (dgfem_mvci_root(c->region.data, n) != n) continue;
        for (int i = n; i < c->nodes.count && !open; i++)
            open = dgfem_mvci_root(c->region.data, i) == n && c->groups.data[i] > 1;
        for (int k = 0; k < faces && !open; k++) {
            int count;
            const int *loop = dgfem_mvci_face_loop(mesh, c->faces.data[k], &count);
            /* after a fan, its face is no longer of that region's old nodes alone: the fan's node has no number */
            if (loop[0] >= c->number.count || dgfem_mvci_root(c->region.data, c->number.data[loop[0]]) != n) continue;
            const int *owner = mesh->faces[c->faces.data[k]].owner;
            if (dgfem_mvci_is_sealed(s, owner[0]) || dgfem_mvci_is_sealed(s, owner[1])) continue;
            dgfem_real area = dgfem_mvci_norm(dgfem_mvci_loop_area(mesh->rest, loop, count));
            if (area > largest) largest = area, best = c->faces.data[k];
        }
        if (!open && best == DGFEM_NONE) faces = dgfem_mvci_leave_region(mesh, c, n, faces);
        if (best == DGFEM_NONE) continue;
        if (!dgfem_mvci_fan(s, mesh, c, best)) return -1;
        made++;
    }
    return made;
}

/* ---- coming apart ---- */

static void dgfem_mvci_rename(const dgfem_mvci_cracks *c, int element, int *nodes, int count) {
    for (int i = 0; i < count; i++) {
        if (nodes[i] >= c->number.count || c->number.data[nodes[i]] == DGFEM_NONE) continue;
        int pair = dgfem_mvci_edges_find(&c->pairs, nodes[i], element);
        nodes[i] = c->copy.data[c->root.data[pair]];
    }
}

static void dgfem_mvci_reverse(int *nodes, int count) {
    for (int i = 0, j = count - 1; i < j; i++, j--) {
        int swap = nodes[i];
        nodes[i] = nodes[j], nodes[j] = swap;
    }
}

/* The side of owner[1] becomes a face of its own. Its triangles keep their order, and the loop its start, so that
   nothing measured differs by round-off from what it was for owner[1] before. 0 when out of memory. */
static int dgfem_mvci_part_face(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, const dgfem_mvci_cracks *c, int face) {
    dgfem_mvci_face old = mesh->faces[face];
    s->buffer.count = 0;
    if (dgfem_mvci_append(s->hooks, &s->buffer, mesh->loops.data + old.loop, old.count) == DGFEM_NONE ||
        dgfem_mvci_append(s->hooks, &s->buffer, mesh->triangles.data + old.triangle, 3 * old.triangle_count) ==
            DGFEM_NONE)
        return 0;
    dgfem_mvci_rename(c, old.owner[1], s->buffer.data, s->buffer.count);
    dgfem_mvci_reverse(s->buffer.data + 1, old.count - 1);
    for (int t = 0; t < old.triangle_count; t++) dgfem_mvci_reverse(s->buffer.data + old.count + 3 * t + 1, 2);
    int other = dgfem_mvci_add_face(mesh, old.owner[1], DGFEM_NONE, s->buffer.data, old.count, DGFEM_NONE, 1);
    if (other == DGFEM_NONE) return 0;
    int start = dgfem_mvci_append(s->hooks, &mesh->triangles, s->buffer.data + old.count, 3 * old.triangle_count);
    if (start == DGFEM_NONE) return 0;
    mesh->faces[other].triangle = start;
    mesh->faces[other].triangle_count = old.triangle_count;
    mesh->faces[face].owner[1] = DGFEM_NONE;
    mesh->faces[face].wall = 1;
    dgfem_mvci_element *element = &mesh->elements[old.owner[1]];
    for (int k = 0; k < element->face_count; k++)
        if (mesh->element_faces.data[element->face + k] == 2 * face + 1)
            mesh->element_faces.data[element->face + k] = 2 * other;
    return 1;
}

/* Copies nodes and doubles faces. 0 when out of memory. */
static int dgfem_mvci_part(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c) {
    int faces = mesh->face_count;
    c->nodes_copied = 0;
    if (!dgfem_mvci_fill(s->hooks, &c->copy, c->root.count, DGFEM_NONE)) return 0;
    for (int p = 0; p < c->root.count; p++) {
        int node = c->pair_node.data[p], root = dgfem_mvci_root(c->root.data, p);
        c->root.data[p] = root;
        if (root != p) continue;
        if (c->groups.data[c->number.data[node]] > 0) { /* the first group keeps the node */
            c->groups.data[c->number.data[node]] = 0;
            c->copy.data[p] = node;
            continue;
        }
        c->copy.data[p] = dgfem_mvci_copy_node(mesh, node);
        if (c->copy.data[p] == DGFEM_NONE) return 0;
        c->nodes_copied++;
    }
    for (int k = 0; k < c->faces.count; k++)
        if (!dgfem_mvci_part_face(s, mesh, c, c->faces.data[k])) return 0;
    for (int f = 0; f < faces; f++) {
        const dgfem_mvci_face *face = &mesh->faces[f];
        if (face->owner[0] == DGFEM_NONE) continue;
        dgfem_mvci_rename(c, face->owner[0], mesh->loops.data + face->loop, face->count);
        dgfem_mvci_rename(c, face->owner[0], mesh->triangles.data + face->triangle, 3 * face->triangle_count);
    }
    return 1;
}

/* ---- one attempt ---- */

/* Elements of a face that are no longer good have failed. */
static dgfem_status dgfem_mvci_check_owners(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int face) {
    for (int side = 0; side < 2; side++) {
        int owner = mesh->faces[face].owner[side];
        if (!dgfem_mvci_guard_element(s, mesh, owner)) return DGFEM_ERROR_MEMORY;
    }
    return DGFEM_OK;
}

/* Splits the elements that a blade passes and, where `open`, parts the faces on it; c->faces: those. Marks the elements
   that the attempt, not those before, has changed. The mesh is spoilt where it fails. DGFEM_ERROR_DEGENERATE: at
   s->failed. */
static dgfem_status dgfem_mvci_cut_attempt(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade,
                                           int open, dgfem_mvci_cracks *c) {
    c->faces.count = 0;
    c->nodes_copied = 0;
    c->levels.count = 0;
    for (int e = 0; e < mesh->element_count; e++) mesh->elements[e].changed = 0;
    if (!dgfem_mvci_select(s, mesh, blade)) return DGFEM_ERROR_MEMORY;
    dgfem_status status = dgfem_mvci_split_selected(s, mesh);
    if (!status && !open) status = dgfem_mvci_guard_elements(s, mesh);
    if (status || !open) return status;

    if (!dgfem_mvci_find_blade_faces(s, mesh, c)) return DGFEM_ERROR_MEMORY;
    if (blade->polygon.count) {
        for (int i = 0; i < blade->polygon.count; i++)
            if (!dgfem_mvci_divide_along(s, mesh, blade, c, blade->polygon.at[i],
                                         blade->polygon.at[(i + 1) % blade->polygon.count]))
                return DGFEM_ERROR_MEMORY;
        status = dgfem_mvci_settle_attempt(s, mesh);
        for (int k = 0; !status && k < c->faces.count; k++) status = dgfem_mvci_check_owners(s, mesh, c->faces.data[k]);
        if (!status && s->failed.count) status = DGFEM_ERROR_DEGENERATE;
        if (status) return status;
        dgfem_mvci_keep_inside(s, mesh, blade, c);
    }
    for (int round = 0; round < 3 && c->faces.count; round++) {
        if (!dgfem_mvci_number_crack(s->hooks, mesh, c) || !dgfem_mvci_group_elements(s->hooks, mesh, c))
            return DGFEM_ERROR_MEMORY;
        int made = round ? 0 : dgfem_mvci_open_mouths(s, mesh, c);
        if (!made && round < 2) made = dgfem_mvci_open_pockets(s, mesh, c);
        if (made < 0) return DGFEM_ERROR_MEMORY;
        if (!made) break;
        status = dgfem_mvci_settle_attempt(s, mesh);
        if (status) return status;
    }
    status = dgfem_mvci_guard_elements(s, mesh); /* neighbours have got nodes, too */
    if (!status && c->faces.count && !dgfem_mvci_part(s, mesh, c)) status = DGFEM_ERROR_MEMORY;
    return status;
}
