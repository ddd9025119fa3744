#pragma once
#include "blade.c"
#include "renew.c"
#include "skin_cut.c"
/* Cutting a body along a blade in world space.

   Each element carries the blade back to the material by its own map X(x) = x + u(x). Where the gradient F is constant
   the world's plane n.X = o is a plane of the material, with the normal m = F^T n; in elements of higher degree it is
   taken where the blade passes the element. Neighbours need not agree: their polynomials jump a little. So

     1. every element gets a side: below, above, or, where it straddles the blade, one for each of the parts that it is
        split into by its own plane;
     2. every glued face between a part below and one above is a wall. Besides the new faces these are the thin strips
        where two planes miss each other, and the faces of elements that are not worth splitting;
     3. walls are cut: all of them, or those that a polygon passes through, which are divided along its edges first. At a
        wall the two sides of a material point have the places X_a and X_b in the world; the polygon has passed between
        them where it meets the segment from X_a to X_b.

                  |  A  :  B  |        A is split along a, B along b; the strip between a and b, a part of their
                  |     :     |        common face, is between A's part above and B's part below: it is a wall
                  |-a---:     |
                  |     :---b-|
                  |     :     |                                                                                  */

/* Planes of two elements that differ by less than this times their radius are taken for one. */
#define DGFEM_SAME_PLANE (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-6))

typedef struct dgfemi_straddler {
    int element;
    int done;
    dgfem_plane plane; /* unit normal */
} dgfemi_straddler;

typedef struct dgfemi_cutter {
    dgfemi_edit *edit;
    const dgfemi_blade *blade;
    dgfem_real snap, smallest, sliver; /* as in dgfem_cut_desc */
    dgfemi_splitter splitter;
    signed char *side; /* [elements] -1, 1, or, where the blade does not reach, 0 */
    dgfem_vec3 *place; /* [elements] of their centres in the world, */
    dgfem_real *reach; /* and how far from there they may extend */
    char *touched;     /* [elements] 1: a part of what was split */
    int side_capacity, place_capacity, reach_capacity, touched_capacity, side_count;
    dgfem_vec3 lower, upper; /* box of the blade */
    dgfemi_straddler *straddlers;
    int straddler_count, straddler_capacity;
    dgfemi_ints walls, group;
    dgfemi_vectors points; /* of an element's cross-section: the ends of its segments, in pairs */
    dgfemi_vectors places; /* of one face, as found */
    dgfem_real slack;      /* the farthest that a plane had to give way */
    int elements_split, faces_cut;
} dgfemi_cutter;

static void dgfemi_cutter_make(dgfemi_cutter *cutter, dgfemi_edit *edit) {
    memset(cutter, 0, sizeof *cutter);
    cutter->edit = edit;
    cutter->splitter = dgfemi_splitter_make(edit->mesh);
    cutter->splitter.components = cutter->splitter.measure = cutter->splitter.local = 1;
}

static void dgfemi_cutter_free(dgfemi_cutter *cutter) {
    const dgfem_hooks *hooks = &cutter->edit->body->hooks;
    dgfemi_splitter_free(&cutter->splitter);
    dgfemi_free(hooks, cutter->side);
    dgfemi_free(hooks, cutter->place);
    dgfemi_free(hooks, cutter->reach);
    dgfemi_free(hooks, cutter->touched);
    dgfemi_free(hooks, cutter->straddlers);
    dgfemi_free(hooks, cutter->walls.data);
    dgfemi_free(hooks, cutter->group.data);
    dgfemi_free(hooks, cutter->points.data);
    dgfemi_free(hooks, cutter->places.data);
}

/* ---- the blade in the material ---- */

/* The plane n.X = o, carried back by the field, near the rest position x. A normal of zero: there is none. */
static dgfem_plane dgfemi_field_plane(const dgfemi_edit *edit, const dgfemi_field *field, dgfem_vec3 normal,
                                      dgfem_real offset, dgfem_vec3 x, dgfem_real reach) {
    dgfem_plane plane;
    int steps = field->degree == 1 ? 0 : 4; /* Newton, towards the blade */
    memset(&plane, 0, sizeof plane);
    for (;; steps--) {
        dgfem_mat3 f, ft;
        dgfem_real distance = dgfemi_dot(normal, dgfemi_field_map(edit, field, x, &f)) - offset, length;
        ft = dgfemi_transposed(&f);
        dgfem_vec3 m = dgfemi_multiply(&ft, normal);
        length = dgfemi_norm(m);
        if (!(length > DGFEM_EPSILON)) return plane;
        if (steps == 0) {
            plane.normal = dgfemi_abs(length - 1) <= 4 * DGFEM_EPSILON ? m : dgfemi_scale(1 / length, m);
            plane.offset = dgfemi_dot(plane.normal, x) - distance / length;
            return plane;
        }
        dgfem_real step = dgfemi_max(-reach, dgfemi_min(distance / length, reach));
        x = dgfemi_add_scaled(x, -step / length, m);
    }
}

/* How far from its centre's place the element may reach in the world. */
static dgfem_real dgfemi_field_reach(const dgfemi_edit *edit, const dgfemi_field *field, const dgfem_element *element) {
    const dgfem_vec3 *u = dgfemi_field_displacement(edit, field);
    dgfem_vec3 moved[DGFEM_MAX_BASIS];
    dgfem_real reach = 0;
    dgfemi_move_polynomial(field->degree, field->origin, field->scale, u, element->centre, element->radius, moved);
    moved[1].x += element->radius, moved[2].y += element->radius, moved[3].z += element->radius;
    for (int i = 1; i < dgfem_monomial_count(field->degree); i++) reach += dgfemi_norm(moved[i]);
    return reach;
}

/* Lowest and highest distance of the element's vertices from a plane with unit normal. */
static void dgfemi_element_extent(const dgfem_mesh *mesh, int element, dgfem_plane plane, dgfem_real *low,
                                  dgfem_real *high) {
    const dgfem_element *e = &mesh->elements[element];
    *low = *high =
        dgfemi_dot(plane.normal, dgfemi_mesh_first_vertex(mesh, mesh->element_faces[e->face_start])) - plane.offset;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (int i = 0; i < mesh->loops[l].count; i++) {
                dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
                dgfem_real d = dgfemi_dot(plane.normal, p) - plane.offset;
                *low = dgfemi_min(*low, d);
                *high = dgfemi_max(*high, d);
            }
    }
}

/* ---- what a polygon covers ---- */

/* Appends to cutter->points, in pairs, the segments in which a plane meets one face of an element, in the world. */
static int dgfemi_cutter_face_section(dgfemi_cutter *cutter, const dgfemi_field *field, const dgfem_face *face,
                                      dgfem_plane plane) {
    const dgfem_hooks *hooks = &cutter->edit->body->hooks;
    const dgfem_mesh *mesh = cutter->edit->mesh;
    dgfemi_crossings *crossings = &cutter->splitter.ups; /* free between splits */
    dgfem_vec3 along = dgfemi_cross(face->normal, plane.normal);
    crossings->count = cutter->places.count = 0;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 a, b = mesh->vertices[loop[mesh->loops[l].count - 1]];
        dgfem_real da, db = dgfemi_dot(plane.normal, b) - plane.offset;
        for (int i = 0; i < mesh->loops[l].count; i++) {
            a = b, da = db;
            b = mesh->vertices[loop[i]], db = dgfemi_dot(plane.normal, b) - plane.offset;
            if ((da >= 0) == (db >= 0)) continue;
            dgfem_vec3 x = dgfemi_add_scaled(a, da / (da - db), dgfemi_sub(b, a));
            dgfem_vec3 place = dgfemi_field_map(cutter->edit, field, x, NULL);
            if (!dgfemi_crossing_push(&mesh->hooks, crossings, dgfemi_dot(along, x), cutter->places.count) ||
                !dgfemi_vectors_push(hooks, &cutter->places, &place, 1))
                return 0;
        }
    }
    dgfemi_crossings_sort(crossings);
    for (int i = 0; i < crossings->count; i++)
        if (!dgfemi_vectors_push(hooks, &cutter->points, &cutter->places.data[crossings->data[i].vertex], 1)) return 0;
    return 1;
}

static int dgfemi_cutter_section(dgfemi_cutter *cutter, int element, dgfem_plane plane) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    const dgfem_element *e = &mesh->elements[element];
    const dgfemi_field *field = dgfemi_field_of(cutter->edit, element);
    cutter->points.count = 0;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++)
        if (!dgfemi_cutter_face_section(cutter, field, &mesh->faces[mesh->element_faces[k]], plane)) return 0;
    return 1;
}

/* Twice the signed area of a triangle in the blade's projection. */
static double dgfemi_turn(const double *a, const double *b, const double *c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static int dgfemi_segments_meet(const double *a, const double *b, const double *c, const double *d) {
    double abc = dgfemi_turn(a, b, c), abd = dgfemi_turn(a, b, d), cda = dgfemi_turn(c, d, a),
           cdb = dgfemi_turn(c, d, b);
    return (abc >= 0) != (abd >= 0) && (cda >= 0) != (cdb >= 0);
}

/* Whether point q lies within the segments (pairs), by parity. */
static int dgfemi_section_covers(const dgfemi_blade *blade, const dgfem_vec3 *points, int count, const double *q) {
    double a[2], b[2];
    int inside = 0;
    for (int i = 0; i + 1 < count; i += 2) {
        dgfemi_blade_project(blade, points[i], a);
        dgfemi_blade_project(blade, points[i + 1], b);
        inside ^= dgfemi_edge_winding(a, b, q) != 0;
    }
    return inside;
}

/* Whether the polygon of the blade and the figure with these boundary segments have points in common. */
static int dgfemi_section_meets(const dgfemi_blade *blade, const dgfem_vec3 *points, int count) {
    double a[2], b[2], c[2], d[2];
    for (int i = 0; i < count; i++)
        if (dgfemi_blade_covers(blade, points[i])) return 1;
    dgfemi_blade_project(blade, blade->polygon[0], a);
    if (dgfemi_section_covers(blade, points, count, a)) return 1;
    for (int k = 0; k < blade->polygon_count; k++) {
        dgfemi_blade_project(blade, blade->polygon[k], a);
        dgfemi_blade_project(blade, blade->polygon[k + 1 < blade->polygon_count ? k + 1 : 0], b);
        for (int i = 0; i + 1 < count; i += 2) {
            dgfemi_blade_project(blade, points[i], c);
            dgfemi_blade_project(blade, points[i + 1], d);
            if (dgfemi_segments_meet(a, b, c, d)) return 1;
        }
    }
    return 0;
}

/* ---- 1. sides ---- */

/* Where an element is in the world: that changes only when it is split. */
static void dgfemi_cutter_find_place(dgfemi_cutter *cutter, int element) {
    const dgfem_element *e = &cutter->edit->mesh->elements[element];
    const dgfemi_field *field = dgfemi_field_of(cutter->edit, element);
    cutter->side[element] = 0, cutter->touched[element] = 0;
    if (e->face_count == 0) return;
    cutter->place[element] = dgfemi_field_map(cutter->edit, field, e->centre, NULL);
    cutter->reach[element] = dgfemi_field_reach(cutter->edit, field, e);
}

/* Takes in the elements that have come since the last call. 1 on success, 0 when out of memory. */
static int dgfemi_cutter_fit_sides(dgfemi_cutter *cutter) {
    const dgfem_hooks *hooks = &cutter->edit->body->hooks;
    void *side = cutter->side, *place = cutter->place, *reach = cutter->reach, *touched = cutter->touched;
    int n = cutter->edit->mesh->element_count;
    int ok = dgfemi_mesh_room(hooks, &side, 0, &cutter->side_capacity, n, 1);
    cutter->side = (signed char *)side;
    ok = ok && dgfemi_mesh_room(hooks, &place, 0, &cutter->place_capacity, n, sizeof(dgfem_vec3));
    cutter->place = (dgfem_vec3 *)place;
    ok = ok && dgfemi_mesh_room(hooks, &reach, 0, &cutter->reach_capacity, n, sizeof(dgfem_real));
    cutter->reach = (dgfem_real *)reach;
    ok = ok && dgfemi_mesh_room(hooks, &touched, 0, &cutter->touched_capacity, n, 1);
    cutter->touched = (char *)touched;
    for (; ok && cutter->side_count < n; cutter->side_count++) dgfemi_cutter_find_place(cutter, cutter->side_count);
    return ok;
}

/* Whether the element's sphere in the world is beside the box of the blade. */
static int dgfemi_cutter_misses(const dgfemi_cutter *cutter, int element) {
    dgfem_vec3 place = cutter->place[element];
    dgfem_vec3 nearest = dgfemi_min3(dgfemi_max3(place, cutter->lower), cutter->upper);
    return cutter->blade->polygon && dgfemi_distance(nearest, place) > DGFEM_R(1.001) * cutter->reach[element];
}

static int dgfemi_cutter_add_straddler(dgfemi_cutter *cutter, int element, dgfem_plane plane) {
    if (cutter->straddler_count == cutter->straddler_capacity) {
        void *grown = dgfemi_grow(&cutter->edit->body->hooks, cutter->straddlers, &cutter->straddler_capacity,
                                  cutter->straddler_count + 1, sizeof *cutter->straddlers);
        if (!grown) return 0;
        cutter->straddlers = (dgfemi_straddler *)grown;
    }
    dgfemi_straddler *s = &cutter->straddlers[cutter->straddler_count++];
    s->element = element, s->done = 0, s->plane = plane;
    return 1;
}

/* What lies no further than this beyond the blade is not split off. */
static dgfem_real dgfemi_cutter_thin(const dgfemi_cutter *cutter, const dgfem_element *e) {
    return dgfemi_max(cutter->snap * e->radius, cutter->smallest);
}

/* Gives an element its side, or lists it for the split. 0 when out of memory. */
static int dgfemi_cutter_take_side(dgfemi_cutter *cutter, int element) {
    const dgfemi_blade *blade = cutter->blade;
    const dgfem_element *e = &cutter->edit->mesh->elements[element];
    const dgfemi_field *field = dgfemi_field_of(cutter->edit, element);
    dgfem_real distance = dgfemi_blade_distance(blade, cutter->place[element]);
    dgfem_real low, high, thin = dgfemi_cutter_thin(cutter, e);
    cutter->side[element] = 0;
    if (dgfemi_cutter_misses(cutter, element)) return 1;
    cutter->side[element] = distance >= 0 ? 1 : -1;
    if (dgfemi_abs(distance) > cutter->reach[element]) return 1;
    dgfem_plane plane = dgfemi_field_plane(cutter->edit, field, blade->normal, blade->offset, e->centre, 2 * e->radius);
    if (!(dgfemi_norm(plane.normal) > 0)) return 1;
    dgfemi_element_extent(cutter->edit->mesh, element, plane, &low, &high);
    if (high < thin || -low < thin) {
        if (-low >= thin || high >= thin) cutter->side[element] = high < thin ? -1 : 1;
        return 1;
    }
    cutter->side[element] = 0;
    if (blade->polygon) {
        if (!dgfemi_cutter_section(cutter, element, plane)) return 0;
        if (!dgfemi_section_meets(blade, cutter->points.data, cutter->points.count)) return 1;
    }
    return dgfemi_cutter_add_straddler(cutter, element, plane);
}

static int dgfemi_cutter_take_sides(dgfemi_cutter *cutter) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    cutter->straddler_count = 0;
    dgfemi_blade_box(cutter->blade, &cutter->lower, &cutter->upper);
    if (!dgfemi_cutter_fit_sides(cutter)) return 0;
    for (int e = 0; e < mesh->element_count; e++)
        if (mesh->elements[e].face_count > 0 && !dgfemi_cutter_take_side(cutter, e)) return 0;
    return 1;
}

/* ---- splitting ---- */

/* Splits the elements of cutter->group by one plane; silently, because a failure here has a way out. */
static dgfem_status dgfemi_cutter_split_by(dgfemi_cutter *cutter, dgfem_plane plane) {
    dgfem_mesh *mesh = cutter->edit->mesh;
    dgfem_hooks hooks = mesh->hooks;
    mesh->hooks.log = NULL;
    dgfem_status status = dgfemi_split_elements(&cutter->splitter, plane, cutter->group.data, cutter->group.count);
    mesh->hooks.log = hooks.log;
    if (status == DGFEM_ERROR_MEMORY || (!status && !dgfemi_cutter_fit_sides(cutter)))
        return dgfemi_fail_memory(&cutter->edit->body->hooks);
    if (status) return status;
    for (int c = 0; c < cutter->splitter.child_count; c++) {
        const dgfemi_split_child *child = &cutter->splitter.children[c];
        if (child->side == 0) continue;
        dgfemi_cutter_find_place(cutter, child->element);
        cutter->side[child->element] = (signed char)child->side;
        cutter->touched[child->element] = 1;
    }
    cutter->elements_split += cutter->splitter.selected.count;
    return DGFEM_OK;
}

/* One element on its own. Where round-off lets it not be split the plane gives way a little, and at last the element
   stays whole, on the side of its centre. */
static dgfem_status dgfemi_cutter_split_alone(dgfemi_cutter *cutter, const dgfemi_straddler *s) {
    static const double shifts[] = {0, 1e-6, -1e-6, 1e-4, -1e-4, 1e-2, -1e-2};
    const dgfem_element *e = &cutter->edit->mesh->elements[s->element];
    dgfem_real radius = e->radius, height = dgfemi_dot(s->plane.normal, e->centre) - s->plane.offset;
    cutter->group.count = 0;
    if (!dgfemi_push(&cutter->edit->body->hooks, &cutter->group, s->element))
        return dgfemi_fail_memory(&cutter->edit->body->hooks);
    for (size_t i = 0; i < sizeof shifts / sizeof *shifts; i++) {
        dgfem_plane plane = s->plane;
        plane.offset += (dgfem_real)shifts[i] * radius;
        dgfem_status status = dgfemi_cutter_split_by(cutter, plane);
        if (status == DGFEM_ERROR_MEMORY) return status;
        if (!status && cutter->splitter.selected.count > 0) {
            cutter->slack = dgfemi_max(cutter->slack, dgfemi_abs((dgfem_real)shifts[i]) * radius);
            return DGFEM_OK;
        }
        if (!status) break; /* the plane runs along it, but for round-off */
    }
    cutter->side[s->element] = height >= 0 ? 1 : -1;
    return DGFEM_OK;
}

/* Splits the first straddler that is left, and with it all that have its plane. */
static dgfem_status dgfemi_cutter_split_group(dgfemi_cutter *cutter, int first) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    dgfem_plane plane = cutter->straddlers[first].plane;
    cutter->group.count = 0;
    for (int i = first; i < cutter->straddler_count; i++) {
        dgfemi_straddler *s = &cutter->straddlers[i];
        const dgfem_element *e = &mesh->elements[s->element];
        dgfem_real tolerance = DGFEM_SAME_PLANE * e->radius;
        dgfem_real here = dgfemi_dot(plane.normal, e->centre) - plane.offset;
        dgfem_real there = dgfemi_dot(s->plane.normal, e->centre) - s->plane.offset;
        if (s->done || !(dgfemi_abs(here - there) <= tolerance) ||
            !(dgfemi_distance(plane.normal, s->plane.normal) <= DGFEM_SAME_PLANE))
            continue;
        s->done = 1;
        if (!dgfemi_push(&cutter->edit->body->hooks, &cutter->group, s->element))
            return dgfemi_fail_memory(&cutter->edit->body->hooks);
    }
    int count = cutter->group.count;
    dgfem_status status = dgfemi_cutter_split_by(cutter, plane);
    if (status == DGFEM_ERROR_MEMORY || (!status && cutter->splitter.selected.count == count)) return status;
    for (int i = first; i < cutter->straddler_count; i++) { /* what was not split, one by one */
        const dgfemi_straddler *s = &cutter->straddlers[i];
        if (!s->done || cutter->side[s->element] != 0) continue;
        status = dgfemi_cutter_split_alone(cutter, s);
        if (status) return status;
    }
    return DGFEM_OK;
}

/* ---- 2. and 3. walls ---- */

static dgfem_vec3 dgfemi_cutter_place(const dgfemi_cutter *cutter, int element, dgfem_vec3 x) {
    return dgfemi_field_map(cutter->edit, dgfemi_field_of(cutter->edit, element), x, NULL);
}

/* Whether the blade, beyond its polygon, goes on into the second element, while the first, on one side of it, meets the
   second in a face that lies along the blade: there the second is on the other side. */
static int dgfemi_cutter_is_along(const dgfemi_cutter *cutter, const dgfem_face *face, int first) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    int a = face->element[first], b = face->element[1 - first];
    const dgfem_element *e = &mesh->elements[a];
    if (cutter->side[a] == 0 || cutter->side[b] != 0 || dgfemi_cutter_misses(cutter, b)) return 0;
    dgfem_plane plane = dgfemi_field_plane(cutter->edit, dgfemi_field_of(cutter->edit, a), cutter->blade->normal,
                                           cutter->blade->offset, e->centre, 2 * e->radius);
    dgfem_real towards = dgfemi_dot(plane.normal, face->normal) * (first == 0 ? 1 : -1); /* from a to b */
    return (dgfem_real)cutter->side[a] * towards < 0 &&
           dgfemi_mesh_face_off_plane(mesh, (int)(face - mesh->faces), plane.normal, plane.offset) <=
               dgfemi_cutter_thin(cutter, e);
}

/* The side of an element that the blade goes on into beyond its polygon, seen from a face. */
static int dgfemi_cutter_side_at(const dgfemi_cutter *cutter, int element, const dgfem_face *face) {
    if (cutter->side[element] != 0) return cutter->side[element];
    if (dgfemi_cutter_misses(cutter, element)) return 0;
    return dgfemi_blade_side(cutter->blade, dgfemi_cutter_place(cutter, element, face->centre)) ? 1 : -1;
}

static int dgfemi_cutter_is_wall(const dgfemi_cutter *cutter, const dgfem_face *face) {
    if (face->element[1] == DGFEM_NONE || face->cut) return 0;
    if (dgfemi_cutter_side_at(cutter, face->element[0], face) * dgfemi_cutter_side_at(cutter, face->element[1], face) <
        0)
        return 1;
    return dgfemi_cutter_is_along(cutter, face, 0) || dgfemi_cutter_is_along(cutter, face, 1);
}

/* Walls have an element with a side. Each is listed by the first of its elements that has one. */
static int dgfemi_cutter_list_walls(dgfemi_cutter *cutter) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    cutter->walls.count = 0;
    for (int element = 0; element < mesh->element_count; element++) {
        const dgfem_element *e = &mesh->elements[element];
        for (int k = e->face_start; cutter->side[element] != 0 && k < e->face_start + e->face_count; k++) {
            const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
            if (face->element[0] != element && cutter->side[face->element[0]] != 0) continue;
            if (dgfemi_cutter_is_wall(cutter, face) &&
                !dgfemi_push(&cutter->edit->body->hooks, &cutter->walls, mesh->element_faces[k]))
                return 0;
        }
    }
    return 1;
}

/* Whether an edge of the polygon passes through the inside of a face; its places in the world come from one side. */
static int dgfemi_cutter_edge_meets(dgfemi_cutter *cutter, int f, dgfem_vec3 from, dgfem_vec3 to) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    const dgfem_face *face = &mesh->faces[f];
    double a[2], b[2], c[2], d[2];
    int from_inside = 0, to_inside = 0;
    dgfemi_blade_project(cutter->blade, from, a);
    dgfemi_blade_project(cutter->blade, to, b);
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count;
        dgfemi_blade_project(cutter->blade,
                             dgfemi_cutter_place(cutter, face->element[0], mesh->vertices[loop[count - 1]]), d);
        for (int i = 0; i < count; i++) {
            memcpy(c, d, sizeof c);
            dgfemi_blade_project(cutter->blade, dgfemi_cutter_place(cutter, face->element[0], mesh->vertices[loop[i]]),
                                 d);
            if (dgfemi_segments_meet(a, b, c, d)) return 1;
            from_inside ^= dgfemi_edge_winding(c, d, a) != 0;
            to_inside ^= dgfemi_edge_winding(c, d, b) != 0;
        }
    }
    return from_inside || to_inside;
}

/* Divides a wall along the edge of the polygon, unless the edge runs along the wall's own. The parts are listed. */
static dgfem_status dgfemi_cutter_divide(dgfemi_cutter *cutter, int wall, dgfem_vec3 from, dgfem_vec3 to) {
    dgfemi_splitter *s = &cutter->splitter;
    dgfem_mesh *mesh = cutter->edit->mesh;
    const dgfem_hooks *own = &cutter->edit->body->hooks;
    dgfem_hooks hooks = mesh->hooks;
    int f = cutter->walls.data[wall], element = mesh->faces[f].element[0];
    const dgfem_face *face = &mesh->faces[f];
    dgfem_vec3 across = dgfemi_normalized(dgfemi_cross(dgfemi_sub(to, from), cutter->blade->normal));
    dgfem_real radius = dgfemi_face_radius(mesh, face), low = 0, high = 0;
    dgfem_plane plane = dgfemi_field_plane(cutter->edit, dgfemi_field_of(cutter->edit, element), across,
                                           dgfemi_dot(across, from), face->centre, 2 * radius);
    if (!(dgfemi_norm(plane.normal) > 0)) return DGFEM_OK;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
        for (int i = 0; i < mesh->loops[l].count; i++) {
            dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
            dgfem_real d = dgfemi_dot(plane.normal, p) - plane.offset;
            low = dgfemi_min(low, d), high = dgfemi_max(high, d);
        }
    dgfem_real thin = dgfemi_max(cutter->snap * radius, DGFEM_SAME_PLANE * radius);
    if (high < thin || -low < thin) return DGFEM_OK;
    if (!dgfemi_split_set_plane(s, plane, &element, 1)) return dgfemi_fail_memory(own);
    mesh->hooks.log = NULL;
    dgfem_status status = dgfemi_split_faces(s, &f, 1);
    mesh->hooks.log = hooks.log;
    if (status == DGFEM_ERROR_MEMORY) return dgfemi_fail_memory(own);
    if (status) return DGFEM_OK; /* stays whole, on one side of the edge */
    for (int i = 0; i < s->cut[f].below + s->cut[f].above; i++) {
        if (i == 0) cutter->walls.data[wall] = s->cut[f].first;
        else if (!dgfemi_push(own, &cutter->walls, s->cut[f].first + i)) return dgfemi_fail_memory(own);
    }
    return DGFEM_OK;
}

static dgfem_status dgfemi_cutter_divide_walls(dgfemi_cutter *cutter) {
    const dgfemi_blade *blade = cutter->blade;
    dgfem_status status = DGFEM_OK;
    for (int k = 0; !status && k < blade->polygon_count; k++) {
        dgfem_vec3 from = blade->polygon[k], to = blade->polygon[k + 1 < blade->polygon_count ? k + 1 : 0];
        int count = cutter->walls.count; /* parts made by this edge are not met by it again */
        for (int w = 0; !status && w < count; w++)
            if (dgfemi_cutter_edge_meets(cutter, cutter->walls.data[w], from, to))
                status = dgfemi_cutter_divide(cutter, w, from, to);
    }
    return status;
}

/* Whether the polygon passes between the two sides of the point x of a face. */
static int dgfemi_cutter_passes(const dgfemi_cutter *cutter, const dgfem_face *face, dgfem_vec3 x) {
    dgfem_vec3 a = dgfemi_cutter_place(cutter, face->element[0], x);
    dgfem_vec3 b = dgfemi_cutter_place(cutter, face->element[1], x);
    dgfem_real da = dgfemi_blade_distance(cutter->blade, a), db = dgfemi_blade_distance(cutter->blade, b);
    dgfem_real t = (da > 0) != (db > 0) ? da / (da - db) : DGFEM_R(0.5);
    return dgfemi_blade_covers(cutter->blade, dgfemi_add_scaled(a, t, dgfemi_sub(b, a)));
}

/* Where a line through the face's centre, along `along`, crosses its boundary: splitter.ups, sorted. 1 on success. */
static int dgfemi_cutter_scan(dgfemi_cutter *cutter, const dgfem_face *face, dgfem_vec3 along) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    dgfemi_crossings *crossings = &cutter->splitter.ups; /* free between splits */
    dgfem_vec3 across = dgfemi_cross(along, face->normal);
    crossings->count = 0;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 a, b = dgfemi_sub(mesh->vertices[loop[mesh->loops[l].count - 1]], face->centre);
        for (int i = 0; i < mesh->loops[l].count; i++) {
            a = b, b = dgfemi_sub(mesh->vertices[loop[i]], face->centre);
            dgfem_real ha = dgfemi_dot(across, a), hb = dgfemi_dot(across, b);
            if ((ha >= 0) == (hb >= 0)) continue;
            dgfem_vec3 x = dgfemi_add_scaled(a, ha / (ha - hb), dgfemi_sub(b, a));
            if (!dgfemi_crossing_push(&mesh->hooks, crossings, dgfemi_dot(along, x), 0)) return 0;
        }
    }
    dgfemi_crossings_sort(crossings);
    return 1;
}

/* A point inside a face: its centre, or, where that is outside, the middle of the longest part of a line through it. */
static int dgfemi_cutter_inner_point(dgfemi_cutter *cutter, const dgfem_face *face, dgfem_vec3 *inner) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    const dgfemi_crossings *crossings = &cutter->splitter.ups;
    dgfem_vec3 first = dgfemi_mesh_first_vertex(mesh, (int)(face - mesh->faces));
    dgfem_vec3 along = dgfemi_normalized(dgfemi_cross(face->normal, dgfemi_sub(first, face->centre)));
    dgfem_real longest = 0;
    *inner = face->centre;
    if (dgfemi_face_covers(mesh, face, face->centre)) return 1;
    if (!dgfemi_cutter_scan(cutter, face, along)) return 0;
    for (int i = 0; i + 1 < crossings->count; i += 2) {
        dgfem_real from = crossings->data[i].t, to = crossings->data[i + 1].t;
        if (!(to - from > longest)) continue;
        longest = to - from;
        *inner = dgfemi_add_scaled(face->centre, (from + to) / 2, along);
    }
    return 1;
}

/* Whether a wall is cut. Caps were divided by the very map that they are seen by: any point inside tells. Strips, divided
   by the map of one side only, have corners that belong to neither part: they are cut where any part of them is, which
   takes no more than the jump is wide. */
static int dgfemi_cutter_is_cut(dgfemi_cutter *cutter, const dgfem_face *face, int *is_cut) {
    const dgfem_real near = DGFEM_R(0.9); /* of the way to a corner */
    const dgfem_mesh *mesh = cutter->edit->mesh;
    dgfem_vec3 inner;
    *is_cut = 1;
    if (!cutter->blade->polygon) return 1;
    if (!dgfemi_cutter_inner_point(cutter, face, &inner)) return 0;
    *is_cut = dgfemi_cutter_passes(cutter, face, inner);
    if (mesh->elements[face->element[0]].tag == mesh->elements[face->element[1]].tag) return 1;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
        for (int i = 0; !*is_cut && i < mesh->loops[l].count; i++) {
            dgfem_vec3 corner = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
            *is_cut = dgfemi_cutter_passes(cutter, face, dgfemi_add_scaled(inner, near, dgfemi_sub(corner, inner)));
        }
    return 1;
}

/* One blade. On failure the edit is of no further use. */
static dgfem_status dgfemi_cutter_apply(dgfemi_cutter *cutter, const dgfemi_blade *blade) {
    const dgfem_hooks *hooks = &cutter->edit->body->hooks;
    dgfem_status status = DGFEM_OK;
    cutter->blade = blade;
    if (!dgfemi_cutter_take_sides(cutter)) return dgfemi_fail_memory(hooks);
    for (int i = 0; !status && i < cutter->straddler_count; i++)
        if (!cutter->straddlers[i].done) status = dgfemi_cutter_split_group(cutter, i);
    if (status) return status;
    if (!dgfemi_cutter_list_walls(cutter)) return dgfemi_fail_memory(hooks);
    if (blade->polygon) status = dgfemi_cutter_divide_walls(cutter);
    for (int w = 0; !status && w < cutter->walls.count; w++) {
        dgfem_face *face = &cutter->edit->mesh->faces[cutter->walls.data[w]];
        int is_cut = 0;
        if (!dgfemi_cutter_is_cut(cutter, face, &is_cut)) status = dgfemi_fail_memory(hooks);
        face->cut = is_cut;
        cutter->faces_cut += is_cut;
    }
    return status;
}

/* Whether one of the blades passes between the two sides of a face, at a point of it. */
static int dgfemi_cutter_parts(const dgfemi_cutter *cutter, const dgfem_face *face, dgfem_vec3 x,
                               const dgfemi_blade *blades, int count) {
    dgfem_vec3 a = dgfemi_cutter_place(cutter, face->element[0], x);
    dgfem_vec3 b = dgfemi_cutter_place(cutter, face->element[1], x);
    for (int k = 0; k < count; k++) {
        dgfem_real da = dgfemi_blade_distance(&blades[k], a), db = dgfemi_blade_distance(&blades[k], b);
        if ((da >= 0) == (db >= 0)) continue;
        if (dgfemi_blade_covers(&blades[k], dgfemi_add_scaled(a, da / (da - db), dgfemi_sub(b, a)))) return 1;
    }
    return 0;
}

static int dgfemi_blade_is_near(const dgfemi_blade *blade, dgfem_vec3 x, dgfem_real distance) {
    if (!(dgfemi_abs(dgfemi_blade_distance(blade, x)) <= distance)) return 0;
    if (dgfemi_blade_covers(blade, x)) return 1;
    for (int k = 0; k < blade->polygon_count; k++) {
        dgfem_vec3 to = blade->polygon[k + 1 < blade->polygon_count ? k + 1 : 0];
        if (dgfemi_distance(dgfemi_nearest_on_segment(blade->polygon[k], to, x), x) <= distance) return 1;
    }
    return 0;
}

/* How far the part of a field that is not affine moves points of the element. */
static dgfem_real dgfemi_field_bend(const dgfemi_edit *edit, const dgfemi_field *field) {
    const dgfem_vec3 *u = dgfemi_field_displacement(edit, field);
    dgfem_real bend = 0;
    for (int i = 4; i < dgfem_monomial_count(field->degree); i++) bend += dgfemi_norm(u[i]);
    return bend;
}

/* Whether a face is no wider than what planes and jumps of its two sides leave undecided, and that near to a blade: a
   thread of glue that holds nothing. */
static int dgfemi_cutter_is_thread(const dgfemi_cutter *cutter, int f, dgfem_vec3 inner, const dgfemi_blade *blades,
                                   int count) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    const dgfem_face *face = &mesh->faces[f];
    int a = face->element[0], b = face->element[1];
    dgfem_vec3 at = dgfemi_cutter_place(cutter, a, inner), there = dgfemi_cutter_place(cutter, b, inner);
    dgfem_real radius = dgfemi_max(mesh->elements[a].radius, mesh->elements[b].radius);
    dgfem_real width = 2 * dgfemi_max(dgfemi_distance(at, there), cutter->snap * radius);
    width = dgfemi_max(width, 2 * cutter->slack);
    width = dgfemi_max(width, dgfemi_field_bend(cutter->edit, dgfemi_field_of(cutter->edit, a)));
    width = dgfemi_max(width, dgfemi_field_bend(cutter->edit, dgfemi_field_of(cutter->edit, b)));
    if (!(face->area <= width * dgfemi_face_radius(mesh, face))) return 0;
    for (int k = 0; k < count; k++)
        if (dgfemi_blade_is_near(&blades[k], at, width)) return 1;
    return 0;
}

/* Whether a point of an element lies in a blade's plane, and no farther than that from what all blades cover. */
static int dgfemi_cutter_is_at(const dgfemi_cutter *cutter, int element, dgfem_vec3 x, dgfem_real distance,
                               const dgfemi_blade *blade, const dgfemi_blade *blades, int count) {
    x = dgfemi_cutter_place(cutter, element, x);
    if (!(dgfemi_abs(dgfemi_blade_distance(blade, x)) <= distance)) return 0;
    for (int k = 0; k < count; k++)
        if (dgfemi_blade_is_near(&blades[k], x, distance)) return 1;
    return 0;
}

/* Whether a face between elements on both sides of a blade lies in its plane, no farther off than planes that are taken
   for one may be, and no farther than that from what all blades cover. Where two meet at a shallow angle, such planes
   miss the edge of both by far more. Faces that are themselves no wider than that are left alone. Corners alone do not
   tell: those of a bridge between two blades lie on their edges. side: of the face's elements, the one that maps its
   points to their places. */
static int dgfemi_cutter_is_flush(const dgfemi_cutter *cutter, const dgfem_face *face, dgfem_vec3 inner, int side,
                                  const dgfemi_blade *blade, const dgfemi_blade *blades, int count) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    int a = face->element[0], b = face->element[1], e = face->element[side];
    dgfem_real radius = dgfemi_max(mesh->elements[a].radius, mesh->elements[b].radius);
    dgfem_real distance = 2 * DGFEM_SAME_PLANE * radius;
    if (dgfemi_blade_side(blade, cutter->place[a]) == dgfemi_blade_side(blade, cutter->place[b])) return 0;
    if (!(face->area > 4 * distance * dgfemi_face_radius(mesh, face))) return 0;
    if (!dgfemi_cutter_is_at(cutter, e, inner, distance, blade, blades, count)) return 0;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
        for (int i = 0; i < mesh->loops[l].count; i++) {
            dgfem_vec3 x = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
            dgfem_vec3 halfway = dgfemi_add_scaled(inner, DGFEM_R(0.5), dgfemi_sub(x, inner));
            if (!dgfemi_cutter_is_at(cutter, e, x, distance, blade, blades, count) ||
                !dgfemi_cutter_is_at(cutter, e, halfway, distance, blade, blades, count))
                return 0;
        }
    return 1;
}

/* Where blades meet at an edge, what is left of strips there belongs to none of them alone: a last look at the glue of
   what was split, for all blades together. 1 on success, 0 when out of memory. */
static int dgfemi_cutter_seal(dgfemi_cutter *cutter, const dgfemi_blade *blades, int count) {
    const dgfem_real near = DGFEM_R(0.9); /* of the way to a corner */
    dgfem_mesh *mesh = cutter->edit->mesh;
    for (int f = 0; count > 1 && f < mesh->face_count; f++) {
        dgfem_face *face = &mesh->faces[f];
        dgfem_vec3 inner;
        if (face->element[0] == DGFEM_NONE || face->element[1] == DGFEM_NONE || face->cut) continue;
        if (!cutter->touched[face->element[0]] && !cutter->touched[face->element[1]]) continue;
        if (!dgfemi_cutter_inner_point(cutter, face, &inner)) return 0;
        int is_cut = dgfemi_cutter_is_thread(cutter, f, inner, blades, count);
        for (int k = 0; !is_cut && k < 2 * count; k++)
            is_cut = dgfemi_cutter_is_flush(cutter, face, inner, k % 2, &blades[k / 2], blades, count);
        if (mesh->elements[face->element[0]].tag != mesh->elements[face->element[1]].tag && !is_cut) {
            is_cut = dgfemi_cutter_parts(cutter, face, inner, blades, count);
            for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
                for (int i = 0; !is_cut && i < mesh->loops[l].count; i++) {
                    dgfem_vec3 corner = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
                    corner = dgfemi_add_scaled(inner, near, dgfemi_sub(corner, inner));
                    is_cut = dgfemi_cutter_parts(cutter, face, corner, blades, count);
                }
        }
        face->cut = is_cut;
        cutter->faces_cut += is_cut;
    }
    return 1;
}

/* 1 for a face that this edit has cut. */
static int dgfemi_cutter_is_new_cut(const dgfemi_cutter *cutter, const dgfem_face *face) {
    if (face->element[1] == DGFEM_NONE || !face->cut) return 0;
    return face->tag == DGFEM_NONE || !cutter->edit->body->mesh->faces[face->tag].cut;
}

/* The neighbour that a part should stay with: the one across its largest cut, when the part is left alone, and is a
   sliver beside it or too thin; else DGFEM_NONE. */
static int dgfemi_cutter_keeper(const dgfemi_cutter *cutter, int element) {
    const dgfem_mesh *mesh = cutter->edit->mesh;
    const dgfem_element *e = &mesh->elements[element];
    dgfem_real area = 0;
    int keeper = DGFEM_NONE;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        if (face->element[1] != DGFEM_NONE && !face->cut) return DGFEM_NONE;
        if (!dgfemi_cutter_is_new_cut(cutter, face) || !(face->area > area)) continue;
        area = face->area, keeper = face->element[face->element[0] == element];
    }
    if (keeper == DGFEM_NONE) return DGFEM_NONE;
    if (dgfemi_is_sliver_of(mesh, element, mesh->elements[keeper].volume, cutter->sliver) ||
        dgfemi_mesh_thickness(mesh, element) < cutter->smallest)
        return keeper;
    return DGFEM_NONE;
}

/* Glues crumbs to what they were cut from, with which they can be merged then. */
static void dgfemi_cutter_glue_crumbs(dgfemi_cutter *cutter) {
    dgfem_mesh *mesh = cutter->edit->mesh;
    for (int element = 0; element < mesh->element_count; element++) {
        const dgfem_element *e = &mesh->elements[element];
        int keeper = cutter->touched[element] ? dgfemi_cutter_keeper(cutter, element) : DGFEM_NONE;
        for (int k = e->face_start; keeper != DGFEM_NONE && k < e->face_start + e->face_count; k++) {
            dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
            if (!dgfemi_cutter_is_new_cut(cutter, face)) continue;
            if (face->element[0] != keeper && face->element[1] != keeper) continue;
            face->cut = 0;
            cutter->faces_cut--;
        }
    }
}

/* ---- the cut ---- */

DGFEM_API dgfem_cut_desc dgfem_default_cut_desc(void) {
    dgfem_cut_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.snap = desc.sliver = DGFEM_R(1e-3);
    return desc;
}

static dgfem_status dgfemi_check_cut(const dgfem_body *body, const dgfem_cut_desc *desc) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_status status = DGFEM_OK;
    if (desc->cookie != DGFEM_COOKIE)
        return dgfemi_fail(hooks, DGFEM_ERROR_DESCRIPTOR, "cut: %s", dgfem_status_text(DGFEM_ERROR_DESCRIPTOR));
    if (!(desc->snap >= 0 && desc->snap <= DGFEM_R(0.5)))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "cut: snap is %g, expected in [0, 0.5]", (double)desc->snap);
    if (!(desc->sliver >= 0 && desc->sliver < 1))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "cut: sliver is %g, expected in [0, 1)", (double)desc->sliver);
    status = dgfemi_check_not_negative(hooks, desc->smallest, "cut: smallest");
    if (status) return status;
    if (desc->skin_count < 0 || (desc->skin_count > 0 && !desc->skins))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "cut: %d skins", desc->skin_count);
    for (int i = 0; i < desc->skin_count; i++)
        if (!desc->skins[i] || desc->skins[i]->embedding->revision != body->revision)
            return dgfemi_fail(hooks, DGFEM_ERROR_REVISION, "cut: skin %d is not up to date with the body", i);
    return DGFEM_OK;
}

/* A skin cut by all blades in turn; *out is new. */
static dgfem_status dgfemi_cut_skin(const dgfem_skin *skin, const dgfem_body *body, const dgfem_body *next,
                                    const dgfemi_blade *blades, int count, dgfem_skin **out) {
    const dgfem_hooks *hooks = &skin->hooks;
    dgfem_status status = DGFEM_OK;
    dgfem_skin *last = NULL;
    dgfemi_ints element;
    memset(&element, 0, sizeof element);
    for (int v = 0; !status && v < skin->vertex_count; v++)
        if (!dgfemi_push(hooks, &element, skin->embedding->point_element[v])) status = dgfemi_fail_memory(hooks);
    for (int b = 0; !status && b < count; b++) {
        int end = b + 1 == count;
        status = dgfemi_skin_cut(last ? last : skin, next, body, &blades[b], end, end ? skin->embedding : NULL,
                                 &element, out);
        dgfem_skin_destroy(last);
        last = *out;
    }
    dgfemi_free(hooks, element.data);
    return status;
}

static dgfem_status dgfemi_cut_skins(const dgfem_cut_desc *desc, const dgfem_body *body, const dgfem_body *next,
                                     const dgfemi_blade *blades, int count, dgfem_skin **cut) {
    dgfem_status status = DGFEM_OK;
    for (int i = 0; !status && i < desc->skin_count; i++) {
        status = dgfemi_cut_skin(desc->skins[i], body, next, blades, count, &cut[i]);
        if (status) cut[i] = NULL;
    }
    if (status)
        for (int i = 0; i < desc->skin_count; i++) dgfem_skin_destroy(cut[i]);
    return status;
}

/* Makes the edited body and its skins, and swaps all of them at once. */
static dgfem_status dgfemi_cut_finish(dgfemi_edit *edit, dgfem_body *body, const dgfemi_blade *blades, int count,
                                      const dgfem_cut_desc *desc) {
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    size_t skins = (size_t)desc->skin_count;
    dgfem_skin **cut = (dgfem_skin **)dgfemi_arena_allocate_zero(&arena, skins, sizeof *cut);
    dgfemi_separation separation;
    dgfemi_renewal renewal;
    memset(&separation, 0, sizeof separation);
    if (!cut) return dgfemi_fail_memory(&body->hooks);
    dgfem_status status = dgfemi_renewal_make(&renewal, edit, body);
    if (!status) {
        if (!dgfemi_separation_find(&renewal, &arena, &separation)) status = dgfemi_fail_memory(&body->hooks);
        if (!status) status = dgfemi_cut_skins(desc, body, &renewal.next, blades, count, cut);
        if (status) dgfemi_renewal_abort(&renewal);
        else dgfemi_renewal_accept(&renewal);
    }
    for (size_t i = 0; !status && i < skins; i++) {
        dgfem_skin last = *desc->skins[i];
        *desc->skins[i] = *cut[i];
        *cut[i] = last;
        dgfem_skin_destroy(cut[i]);
    }
    if (!status) dgfemi_separation_tell(&separation, body, desc->new_piece, desc->new_piece_user);
    dgfemi_arena_free(&arena);
    return status;
}

static dgfem_status dgfemi_body_cut(dgfem_body *body, const dgfemi_blade *blades, int count, const dgfem_cut_desc *desc,
                                    dgfem_cut_info *info) {
    dgfemi_edit edit;
    dgfemi_cutter cutter;
    dgfem_status status = dgfemi_edit_begin(&edit, body);
    memset(info, 0, sizeof *info);
    if (status) return status;
    dgfemi_cutter_make(&cutter, &edit);
    cutter.snap = desc->snap, cutter.smallest = desc->smallest, cutter.sliver = desc->sliver;
    for (int b = 0; !status && b < count; b++) status = dgfemi_cutter_apply(&cutter, &blades[b]);
    if (!status && !dgfemi_cutter_seal(&cutter, blades, count)) status = dgfemi_fail_memory(&body->hooks);
    if (!status) dgfemi_cutter_glue_crumbs(&cutter);
    info->elements_split = cutter.elements_split, info->faces_cut = cutter.faces_cut;
    dgfemi_cutter_free(&cutter);
    if (!status && (desc->sliver > 0 || desc->smallest > 0))
        status = dgfemi_edit_merge(&edit, desc->sliver, desc->smallest, 0, &info->slivers_merged);
    if (!status && info->faces_cut > 0) status = dgfemi_cut_finish(&edit, body, blades, count, desc);
    dgfemi_edit_free(&edit);
    if (status || info->faces_cut == 0) memset(info, 0, sizeof *info);
    return status;
}

DGFEM_API dgfem_status dgfem_body_cut_plane(dgfem_body *body, dgfem_plane plane, const dgfem_cut_desc *desc,
                                            dgfem_cut_info *info) {
    dgfem_cut_desc standard = dgfem_default_cut_desc();
    dgfem_cut_info ignored;
    dgfemi_blade blade;
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_cut(body, desc ? desc : &standard);
    if (!status) status = dgfemi_split_check_plane(&body->hooks, plane);
    if (status) return status;
    memset(&blade, 0, sizeof blade);
    dgfem_real length = dgfemi_norm(plane.normal);
    blade.normal = dgfemi_normalized(plane.normal);
    blade.offset = dgfemi_abs(length - 1) <= 4 * DGFEM_EPSILON ? plane.offset : plane.offset / length;
    return dgfemi_body_cut(body, &blade, 1, desc ? desc : &standard, info ? info : &ignored);
}

/* ---- polygons ---- */

/* Copies n points into memory of the arena; NULL and a status on failure. */
static dgfem_status dgfemi_cut_points(const dgfem_body *body, dgfemi_arena *arena, dgfem_points_in points,
                                      dgfem_vec3 **out) {
    dgfem_status status =
        dgfemi_check_points(&body->hooks, points.data, points.type, points.stride, points.count, "cut");
    if (status) return status;
    *out = (dgfem_vec3 *)dgfemi_arena_allocate(arena, (size_t)points.count, sizeof **out);
    if (!*out) return dgfemi_fail_memory(&body->hooks);
    for (int i = 0; i < points.count; i++) {
        (*out)[i] = dgfemi_point_read(&points, i);
        if (!dgfemi_is_finite3((*out)[i]))
            return dgfemi_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "cut: vertex %d", i);
    }
    return DGFEM_OK;
}

/* The polygon's plane. Normal zero: it has no area. */
static void dgfemi_blade_set(dgfemi_blade *blade, const dgfem_vec3 *polygon, int count) {
    dgfem_vec3 twice = dgfemi_vec3(0, 0, 0), middle = twice;
    dgfem_real size = 0;
    for (int i = 2; i < count; i++)
        twice =
            dgfemi_add(twice, dgfemi_cross(dgfemi_sub(polygon[i - 1], polygon[0]), dgfemi_sub(polygon[i], polygon[0])));
    for (int i = 0; i < count; i++) {
        middle = dgfemi_add_scaled(middle, 1 / (dgfem_real)count, dgfemi_sub(polygon[i], polygon[0]));
        size = dgfemi_max(size, dgfemi_distance(polygon[i], polygon[0]));
    }
    memset(blade, 0, sizeof *blade);
    blade->polygon = polygon, blade->polygon_count = count;
    if (!(dgfemi_norm(twice) > 1000 * DGFEM_EPSILON * size * size)) return;
    blade->normal = dgfemi_normalized(twice);
    blade->offset = dgfemi_dot(blade->normal, dgfemi_add(polygon[0], middle));
}

/* Planar, and no two edges cross. */
static dgfem_status dgfemi_check_polygon(const dgfem_body *body, const dgfemi_blade *blade) {
    const dgfem_hooks *hooks = &body->hooks;
    const dgfem_real flat = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-3) : DGFEM_R(1e-6);
    int n = blade->polygon_count;
    double a[2], b[2], c[2], d[2];
    dgfem_real size = 0;
    for (int i = 1; i < n; i++) size = dgfemi_max(size, dgfemi_distance(blade->polygon[i], blade->polygon[0]));
    if (!(dgfemi_norm(blade->normal) > 0))
        return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "cut: the polygon has no area");
    for (int i = 0; i < n; i++) {
        dgfem_real distance = dgfemi_blade_distance(blade, blade->polygon[i]);
        if (!(dgfemi_abs(distance) <= flat * size))
            return dgfemi_fail(hooks, DGFEM_ERROR_NOT_PLANAR, "cut: vertex %d of the polygon is %g off its plane", i,
                               (double)distance);
    }
    for (int i = 0; i < n; i++)
        for (int k = i + 2; k < n; k++) {
            if (i == 0 && k == n - 1) continue;
            dgfemi_blade_project(blade, blade->polygon[i], a);
            dgfemi_blade_project(blade, blade->polygon[i + 1], b);
            dgfemi_blade_project(blade, blade->polygon[k], c);
            dgfemi_blade_project(blade, blade->polygon[(k + 1) % n], d);
            if (dgfemi_segments_meet(a, b, c, d))
                return dgfemi_fail(hooks, DGFEM_ERROR_NOT_SIMPLE, "cut: edges %d and %d of the polygon cross", i, k);
        }
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_body_cut_polygon(dgfem_body *body, dgfem_points_in polygon, const dgfem_cut_desc *desc,
                                              dgfem_cut_info *info) {
    dgfem_cut_desc standard = dgfem_default_cut_desc();
    dgfem_cut_info ignored;
    dgfem_vec3 *points = NULL;
    dgfemi_blade blade;
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_cut(body, desc ? desc : &standard);
    if (!status && polygon.count < 3)
        status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: a polygon of %d vertices", polygon.count);
    if (status) return status;
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    status = dgfemi_cut_points(body, &arena, polygon, &points);
    if (!status) {
        dgfemi_blade_set(&blade, points, polygon.count);
        status = dgfemi_check_polygon(body, &blade);
    }
    if (!status) status = dgfemi_body_cut(body, &blade, 1, desc ? desc : &standard, info ? info : &ignored);
    dgfemi_arena_free(&arena);
    return status;
}

/* ---- surfaces ---- */

/* One blade for each triangle that has an area. */
static dgfem_status dgfemi_cut_triangles(dgfem_body *body, dgfemi_arena *arena, dgfem_points_in vertices,
                                         const int *triangles, int count, const dgfem_cut_desc *desc,
                                         dgfem_cut_info *info) {
    dgfem_vec3 *points = NULL, *corners;
    dgfemi_blade *blades;
    int blade_count = 0;
    dgfem_status status = dgfemi_cut_points(body, arena, vertices, &points);
    if (status) return status;
    corners = (dgfem_vec3 *)dgfemi_arena_allocate(arena, 3 * (size_t)count, sizeof *corners);
    blades = (dgfemi_blade *)dgfemi_arena_allocate(arena, (size_t)count, sizeof *blades);
    if (!corners || !blades) return dgfemi_fail_memory(&body->hooks);
    for (int t = 0; t < count; t++) {
        for (int i = 0; i < 3; i++) {
            int v = triangles[3 * t + i];
            if (v < 0 || v >= vertices.count)
                return dgfemi_fail(&body->hooks, DGFEM_ERROR_INDEX, "cut: triangle %d names vertex %d of %d", t, v,
                                   vertices.count);
            corners[3 * t + i] = points[v];
        }
        dgfemi_blade_set(&blades[blade_count], corners + 3 * t, 3);
        blade_count += dgfemi_norm(blades[blade_count].normal) > 0;
    }
    return dgfemi_body_cut(body, blades, blade_count, desc, info);
}

DGFEM_API dgfem_status dgfem_body_cut_surface(dgfem_body *body, dgfem_points_in vertices, const int *triangles,
                                              int triangle_count, const dgfem_cut_desc *desc, dgfem_cut_info *info) {
    dgfem_cut_desc standard = dgfem_default_cut_desc();
    dgfem_cut_info ignored;
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_cut(body, desc ? desc : &standard);
    if (!status && (triangle_count < 0 || triangle_count > INT_MAX / 3 || (triangle_count > 0 && !triangles)))
        status = dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: %d triangles", triangle_count);
    if (status) return status;
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    status = dgfemi_cut_triangles(body, &arena, vertices, triangles, triangle_count, desc ? desc : &standard,
                                  info ? info : &ignored);
    dgfemi_arena_free(&arena);
    return status;
}
