#pragma once
#include "skin_cap.c"
/* Third part of cutting a render mesh: the vertices on both sides, the walls, and which elements carry them. */

/* ---- vertices of the result ---- */

static int dgfemi_skin_add_vertex(dgfemi_skin_cutter *c, dgfem_vec3 rest, dgfem_vec3 anchor, dgfem_vec3 world, int a,
                                  int b, dgfem_real weight, int side, int element) {
    void *grown = dgfemi_one_more(c->hooks, c->vertices, c->vertex_count, &c->vertex_capacity, sizeof *c->vertices);
    dgfemi_skin_vertex *v;
    if (!grown) return DGFEM_NONE;
    c->vertices = (dgfemi_skin_vertex *)grown;
    v = &c->vertices[c->vertex_count];
    v->rest = rest, v->anchor = anchor, v->world = world, v->side = side, v->slit = 0, v->element = element;
    v->parent[0] = a, v->parent[1] = b, v->weight = weight, v->weld = c->vertex_count;
    return c->vertex_count++;
}

static int dgfemi_skin_first_out(const dgfemi_skin_cutter *c, int point) {
    if (point < c->skin->vertex_count) return point;
    return c->points[point].out[0] != DGFEM_NONE ? c->points[point].out[0] : c->points[point].out[1];
}

/* The vertex of a point as seen from a side (0 below, 1 above): an old vertex keeps its index on the side that asks
   first. DGFEM_NONE when out of memory. */
static int dgfemi_skin_vertex_of(dgfemi_skin_cutter *c, int point, int s) {
    dgfemi_skin_point *p = &c->points[point], *weld = &c->points[p->weld];
    int separated = dgfemi_skin_is_separated(c, weld), side = weld->sign, v = point;
    if (p->out[s] != DGFEM_NONE) return p->out[s];
    if (separated || side == 0) side = weld->flags & (s ? DGFEMI_BELOW : DGFEMI_ABOVE) && !separated ? 0 : s ? 1 : -1;
    if (point >= c->skin->vertex_count)
        v = dgfemi_skin_add_vertex(c, p->rest, p->anchor, p->world, dgfemi_skin_first_out(c, p->parent[0]),
                                   dgfemi_skin_first_out(c, p->parent[1]), p->t, side, p->element);
    else if (p->out[1 - s] != DGFEM_NONE)
        v = dgfemi_skin_add_vertex(c, p->rest, p->anchor, p->world, point, point, 0, side, p->element);
    if (v == DGFEM_NONE) return DGFEM_NONE;
    c->vertices[v].side = side, c->vertices[v].slit = separated;
    p->out[s] = v;
    if (!separated) p->out[1 - s] = v;
    for (int k = 0; k < 2; k++)
        if (p->out[k] == v && (weld->first[k] == DGFEM_NONE || v < weld->first[k])) weld->first[k] = v;
    return v;
}

/* Vertices of all parts, points of edges before tips, whose parents they are; then welds. 1 on success. */
static int dgfemi_skin_make_vertices(dgfemi_skin_cutter *c) {
    int old = c->skin->vertex_count;
    for (int v = 0; v < old; v++)
        if (dgfemi_skin_add_vertex(c, c->points[v].rest, c->points[v].anchor, c->points[v].world, DGFEM_NONE,
                                   DGFEM_NONE, 0, dgfemi_skin_sign(c, v), c->points[v].element) == DGFEM_NONE)
            return 0;
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < 3 * c->part_count; i++) {
            const dgfemi_skin_part *part = &c->parts[i / 3];
            int point = part->corner[i % 3];
            int is_tip = point >= old && (c->points[point].parent[0] >= old || c->points[point].parent[1] >= old);
            if (is_tip == pass && dgfemi_skin_vertex_of(c, point, part->side == DGFEMI_ABOVE) == DGFEM_NONE) return 0;
        }
    for (int i = 0; i < 3 * c->part_count; i++) {
        const dgfemi_skin_part *part = &c->parts[i / 3];
        int point = part->corner[i % 3], s = part->side == DGFEMI_ABOVE, v = c->points[point].out[s];
        c->vertices[v].weld = c->points[c->points[point].weld].first[s];
        if (!dgfemi_push(c->hooks, &c->triangles, v)) return 0;
    }
    return 1;
}

/* The wall's vertex on a side of a point of the cross-section. DGFEM_NONE when out of memory. */
static int dgfemi_skin_wall_vertex(dgfemi_skin_cutter *c, int cap, int s) {
    dgfemi_cap_point *p = &c->caps[cap];
    int v, a = DGFEM_NONE, b = DGFEM_NONE, side = s ? 1 : -1, weld = DGFEM_NONE;
    dgfem_vec3 anchor = p->rest;
    if (p->out[s] != DGFEM_NONE) return p->out[s];
    if (p->weld != DGFEM_NONE) { /* a copy of the skin's own vertex there */
        weld = a = b = c->points[p->weld].first[s];
        side = c->vertices[a].side, anchor = c->vertices[a].anchor;
    } else if (p->parent[0] != DGFEM_NONE) {
        a = c->caps[p->parent[0]].out[s], b = c->caps[p->parent[1]].out[s];
        anchor = dgfemi_scale(DGFEM_R(0.5), dgfemi_add(c->vertices[a].anchor, c->vertices[b].anchor));
    } else { /* on the slit's front */
        side = 0, weld = p->out[1 - s];
    }
    v = dgfemi_skin_add_vertex(c, p->rest, anchor, p->world, a, b, p->weld == DGFEM_NONE && a != b ? DGFEM_R(0.5) : 0,
                               side, p->element);
    if (v == DGFEM_NONE) return DGFEM_NONE;
    if (weld != DGFEM_NONE) c->vertices[v].weld = weld;
    c->vertices[v].slit = side != 0;
    c->caps[cap].out[s] = v;
    return v;
}

/* The walls: below with the normal along the blade's, above against it. 1 on success. */
static int dgfemi_skin_make_walls(dgfemi_skin_cutter *c) {
    char *used = (char *)dgfemi_allocate_zero(c->hooks, (size_t)c->cap_count, 1);
    int ok = used != NULL;
    for (int i = 0; ok && i < c->cap_triangles.count; i++) used[c->cap_triangles.data[i]] = 1;
    for (int i = c->cap_count - 1; ok && i >= 0; i--) /* parents too */
        for (int k = 0; used[i] && k < 2; k++)
            if (c->caps[i].parent[k] != DGFEM_NONE) used[c->caps[i].parent[k]] = 1;
    for (int i = 0; ok && i < c->cap_count; i++)
        for (int s = 0; ok && used[i] && s < 2; s++) ok = dgfemi_skin_wall_vertex(c, i, s) != DGFEM_NONE;
    for (int s = 0; ok && s < 2; s++)
        for (int i = 0; ok && i < c->cap_triangles.count; i++) {
            int corner = s && i % 3 ? i - i % 3 + 3 - i % 3 : i;
            ok = dgfemi_push(c->hooks, &c->triangles, c->caps[c->cap_triangles.data[corner]].out[s]);
        }
    dgfemi_free(c->hooks, used);
    return ok;
}

/* ---- places: no weight across the cut ---- */

/* The elements as the blade sees them. */
typedef struct dgfemi_blade_sides {
    signed char *sign; /* [elements] side of the element's centre */
    char *at_blade;    /* [elements] 1 for those with a face that the blade has cut */
    char *at_cut;      /* [elements] 1 for those with a cut face */
    char *on_blade;    /* [faces] */
    int *mark, *queue; /* [elements] search that met the element last; room for one search */
    int stamp;
} dgfemi_blade_sides;

static dgfem_vec3 dgfemi_skin_element_world(const dgfem_body *body, int element, dgfem_vec3 x) {
    return dgfemi_add(x, dgfemi_evaluate(body, body->displacement, element, x));
}

/* Whether the blade has cut a face that is open: near it, between elements whose centres are on different sides. */
static int dgfemi_skin_is_on_blade(const dgfemi_skin_cutter *c, const dgfemi_blade_sides *sides, int face) {
    const dgfem_mesh *mesh = c->body->mesh;
    const dgfem_face *f = &mesh->faces[face];
    int a = f->element[0], b = f->element[1];
    dgfem_vec3 x;
    if (sides->sign[a] == sides->sign[b]) return 0;
    x = dgfemi_scale(DGFEM_R(0.5), dgfemi_add(dgfemi_skin_element_world(c->body, a, f->centre),
                                              dgfemi_skin_element_world(c->body, b, f->centre)));
    return dgfemi_abs(dgfemi_blade_distance(c->blade, x)) <=
               dgfemi_max(mesh->elements[a].radius, mesh->elements[b].radius) &&
           dgfemi_blade_covers(c->blade, x);
}

static int dgfemi_skin_find_sides(dgfemi_arena *arena, const dgfemi_skin_cutter *c, dgfemi_blade_sides *sides) {
    const dgfem_mesh *mesh = c->body->mesh;
    size_t elements = (size_t)mesh->element_count;
    memset(sides, 0, sizeof *sides);
    sides->sign = (signed char *)dgfemi_arena_allocate(arena, elements, 1);
    sides->at_blade = (char *)dgfemi_arena_allocate_zero(arena, elements, 1);
    sides->at_cut = (char *)dgfemi_arena_allocate_zero(arena, elements, 1);
    sides->on_blade = (char *)dgfemi_arena_allocate_zero(arena, (size_t)mesh->face_count, 1);
    sides->mark = (int *)dgfemi_arena_allocate_zero(arena, elements, sizeof(int));
    sides->queue = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    if (!sides->sign || !sides->at_blade || !sides->at_cut || !sides->on_blade || !sides->mark || !sides->queue)
        return 0;
    for (int e = 0; e < mesh->element_count; e++)
        sides->sign[e] =
            dgfemi_blade_side(c->blade, dgfemi_skin_element_world(c->body, e, mesh->elements[e].centre)) ? 1 : -1;
    for (int f = 0; f < mesh->face_count; f++) {
        int a = mesh->faces[f].element[0], b = mesh->faces[f].element[1];
        if (b == DGFEM_NONE || !mesh->faces[f].cut) continue;
        sides->at_cut[a] = sides->at_cut[b] = 1;
        if (dgfemi_skin_is_on_blade(c, sides, f)) sides->on_blade[f] = sides->at_blade[a] = sides->at_blade[b] = 1;
    }
    return 1;
}

/* Whether an element may lie nearer to x than a distance. */
static int dgfemi_skin_is_nearer(const dgfemi_locator *locator, int element, dgfem_vec3 x, dgfem_real distance) {
    return dgfemi_box_square(locator->lower[element], locator->upper[element], x) < distance * distance;
}

/* The element on a side that is nearest to x, of those around `element`; it must be reached through glued faces and
   through this cut, not through earlier ones. Without any the element itself. */
static dgfemi_location dgfemi_skin_nearest_on_side(dgfemi_blade_sides *sides, const dgfemi_locator *locator,
                                                   int element, dgfem_vec3 x, int side) {
    const dgfem_mesh *mesh = locator->mesh;
    dgfemi_location best;
    int count = 1;
    best.element = DGFEM_NONE, best.distance = mesh->elements[element].radius, best.nearest = x;
    sides->queue[0] = element, sides->mark[element] = ++sides->stamp;
    for (int i = 0; i < count; i++) {
        const dgfem_element *e = &mesh->elements[sides->queue[i]];
        if (!dgfemi_skin_is_nearer(locator, sides->queue[i], x, best.distance)) continue;
        if (sides->sign[sides->queue[i]] == side) {
            dgfemi_location location = dgfemi_locate_in(mesh, sides->queue[i], x);
            if (location.distance < best.distance) best = location;
        }
        for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
            const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
            int other = face->element[face->element[0] == sides->queue[i]];
            if (other == DGFEM_NONE || sides->mark[other] == sides->stamp) continue;
            if (face->cut && !sides->on_blade[mesh->element_faces[k]]) continue;
            if (!dgfemi_skin_is_nearer(locator, other, x, best.distance)) continue;
            sides->mark[other] = sides->stamp;
            sides->queue[count++] = other;
        }
    }
    return best.element == DGFEM_NONE ? dgfemi_locate_in(mesh, element, x) : best;
}

/* The vertex that a new one is a copy of, on the same side of the cut; DGFEM_NONE: there is none. */
static int dgfemi_skin_twin(const dgfemi_skin_cutter *c, int vertex) {
    const dgfemi_skin_vertex *v = &c->vertices[vertex], *parent;
    if (vertex < c->skin->vertex_count || v->parent[0] == DGFEM_NONE || v->parent[0] != v->parent[1]) return DGFEM_NONE;
    parent = &c->vertices[v->parent[0]];
    return parent->side == v->side && parent->slit == v->slit ? v->parent[0] : DGFEM_NONE;
}

/* Places of the vertices of the result; those at the cut get anchors on their own side, and those in other elements
   at a cut get anchors inside them. The skin's own vertices are where they were if their elements are; `kinship`
   NULL: all are. */
static void dgfemi_skin_place(dgfemi_skin_cutter *c, dgfemi_blade_sides *sides, const dgfemi_kinship *kinship,
                              dgfemi_places *places) {
    dgfemi_locator *locator = places->locator;
    const dgfem_mesh *mesh = c->body->mesh;
    const dgfem_embedding *old = c->skin->embedding;
    for (int i = 0; i < c->vertex_count; i++) {
        dgfemi_skin_vertex *v = &c->vertices[i];
        int moved = !dgfemi_same_position(v->anchor, v->rest), known, e = DGFEM_NONE, near;
        int twin = dgfemi_skin_twin(c, i);
        dgfemi_location location;
        if (twin != DGFEM_NONE) {
            v->anchor = c->vertices[twin].anchor;
            places->element[i] = places->element[twin], places->window[i] = places->window[twin];
            continue;
        }
        if (i < c->skin->vertex_count)
            e = kinship ? kinship->new_element[old->point_element[i]] : old->point_element[i];
        known = e != DGFEM_NONE;
        if (!known) location = dgfemi_locate(locator, v->anchor), e = location.element;
        near = dgfemi_abs(dgfemi_blade_distance(c->blade, v->world)) < DGFEM_R(0.1) * mesh->elements[e].radius;
        if (v->side != 0 && (v->slit || (sides->at_blade[e] && (near || sides->sign[e] != v->side)))) {
            if (sides->sign[e] != v->side)
                location = dgfemi_skin_nearest_on_side(sides, locator, e, v->anchor, v->side);
            else if (known) location = dgfemi_locate_in(mesh, e, v->anchor);
            e = location.element;
            v->anchor = dgfemi_locate_inside(mesh, e, location.nearest);
            known = 0;
        } else if (!moved && sides->at_cut[e]) {
            if (known) location = dgfemi_locate_in(mesh, e, v->rest);
            v->anchor = dgfemi_locate_inside(mesh, e, location.nearest);
        }
        if (!known && moved) location = dgfemi_locate_in(mesh, e, v->rest);
        places->element[i] = e;
        places->window[i] = known ? old->point_window[i] : dgfemi_window_position(mesh, &location, v->rest);
    }
}

/* ---- triangles across a cut ---- */

/* A corner that is to be carried by another element. */
typedef struct dgfemi_skin_tear {
    int corner, vertex, weld, copy; /* place in the triangles; the vertex there and its weld; what it becomes */
    dgfemi_location location;
} dgfemi_skin_tear;

/* The blade cuts elements and triangles each by themselves; where a body is cut again and again as it moves, slits of
   the two may end a little beside each other, and a triangle is left whose corners are carried by elements that nothing
   holds together any more. It would be drawn out without end: instead its corners in the minority move to the others'
   side. A vertex of which all triangles ask for it moves, of any other a copy does. */
typedef struct dgfemi_skin_tearer {
    dgfemi_skin_cutter *cutter;
    const dgfemi_locator *locator;
    dgfemi_places *places;
    int *group; /* [elements] search that met it last */
    int *queue; /* [elements] */
    int stamp;
    dgfemi_skin_tear *tears;
    int tear_count, tear_capacity;
} dgfemi_skin_tearer;

/* A ball around a triangle at rest and the elements that carry it: what holds its corners together is sought there. */
static dgfem_real dgfemi_skin_ball(const dgfemi_skin_tearer *t, const int *corner, dgfem_vec3 *centre) {
    const dgfemi_skin_cutter *c = t->cutter;
    dgfem_real radius = 0;
    *centre = dgfemi_vec3(0, 0, 0);
    for (int k = 0; k < 3; k++) *centre = dgfemi_add_scaled(*centre, DGFEM_R(1) / 3, c->vertices[corner[k]].anchor);
    for (int k = 0; k < 3; k++)
        radius = dgfemi_max(radius, dgfemi_distance(*centre, c->vertices[corner[k]].anchor) +
                                        2 * t->locator->mesh->elements[t->places->element[corner[k]]].radius);
    return radius;
}

/* How many corners of a triangle the last search has met. */
static int dgfemi_skin_count_held(const dgfemi_skin_tearer *t, const int *corner) {
    int count = 0;
    for (int k = 0; k < 3; k++) count += t->group[t->places->element[corner[k]]] == t->stamp;
    return count;
}

/* Marks the elements that hang together with `first` through glued faces and reach into the ball, until all corners of
   the triangle are met; returns their number, with the elements in t->queue. */
static int dgfemi_skin_flood_ball(dgfemi_skin_tearer *t, int first, const int *corner, dgfem_vec3 centre,
                                  dgfem_real radius) {
    const dgfem_mesh *mesh = t->locator->mesh;
    int count = 1;
    t->queue[0] = first, t->group[first] = ++t->stamp;
    for (int i = 0; i < count && dgfemi_skin_count_held(t, corner) < 3; i++) {
        const dgfem_element *e = &mesh->elements[t->queue[i]];
        for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
            const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
            int other = face->element[face->element[0] == t->queue[i]];
            if (other == DGFEM_NONE || face->cut || t->group[other] == t->stamp) continue;
            if (!dgfemi_skin_is_nearer(t->locator, other, centre, radius)) continue;
            t->group[other] = t->stamp;
            t->queue[count++] = other;
        }
    }
    return count;
}

static int dgfemi_skin_are_glued(const dgfem_mesh *mesh, int a, int b) {
    const dgfem_element *e = &mesh->elements[a];
    for (int k = e->face_start; a != b && k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        if (!face->cut && face->element[face->element[0] == a] == b) return 1;
    }
    return a == b;
}

/* Whether three elements hang together by themselves, as nearly all do. */
static int dgfemi_skin_hang_together(const dgfem_mesh *mesh, int a, int b, int c) {
    return dgfemi_skin_are_glued(mesh, a, b) + dgfemi_skin_are_glued(mesh, b, c) +
               dgfemi_skin_are_glued(mesh, c, a) >=
           2;
}

/* Floods from the corner whose surroundings hold most of the three. Returns the number of elements; *held: of
   corners. */
static int dgfemi_skin_flood_majority(dgfemi_skin_tearer *t, const int *corner, int *held) {
    dgfem_vec3 centre;
    dgfem_real radius = dgfemi_skin_ball(t, corner, &centre);
    int best = 0;
    *held = 0;
    for (int k = 0; k < 3; k++) {
        int elements = dgfemi_skin_flood_ball(t, t->places->element[corner[k]], corner, centre, radius);
        int count = dgfemi_skin_count_held(t, corner);
        if (count > *held) *held = count, best = k;
        if (count == 3) return elements;
    }
    return dgfemi_skin_flood_ball(t, t->places->element[corner[best]], corner, centre, radius);
}

/* Lists the corners of a triangle that are to move. 1 on success. */
static int dgfemi_skin_find_tears(dgfemi_skin_tearer *t, int first) {
    const int *corner = t->cutter->triangles.data + first;
    int held, count = dgfemi_skin_flood_majority(t, corner, &held);
    for (int k = 0; held < 3 && k < 3; k++) {
        dgfem_vec3 rest = t->cutter->vertices[corner[k]].rest;
        dgfemi_skin_tear *tear;
        void *grown;
        if (t->group[t->places->element[corner[k]]] == t->stamp) continue;
        grown = dgfemi_one_more(t->cutter->hooks, t->tears, t->tear_count, &t->tear_capacity, sizeof *t->tears);
        if (!grown) return 0;
        t->tears = (dgfemi_skin_tear *)grown;
        tear = &t->tears[t->tear_count++];
        tear->corner = first + k, tear->vertex = corner[k], tear->copy = DGFEM_NONE;
        tear->weld = t->cutter->vertices[corner[k]].weld;
        tear->location = dgfemi_locate_in(t->locator->mesh, t->queue[0], rest);
        for (int i = 1; i < count; i++) {
            dgfemi_location location = dgfemi_locate_in(t->locator->mesh, t->queue[i], rest);
            if (location.distance < tear->location.distance) tear->location = location;
        }
    }
    return 1;
}

static int dgfemi_compare_tears(const void *a, const void *b) {
    const dgfemi_skin_tear *s = (const dgfemi_skin_tear *)a, *t = (const dgfemi_skin_tear *)b;
    if (s->weld != t->weld) return s->weld < t->weld ? -1 : 1;
    if (s->location.element != t->location.element) return s->location.element < t->location.element ? -1 : 1;
    if (s->vertex != t->vertex) return s->vertex < t->vertex ? -1 : 1;
    return s->corner < t->corner ? -1 : s->corner > t->corner;
}

/* Fills `copy`: the vertex itself where all its triangles want it moved to one element, else one copy for each element.
   used [vertices]: corners at each. 1 on success. */
static int dgfemi_skin_copy_torn(dgfemi_skin_tearer *t, const int *used) {
    dgfemi_skin_cutter *c = t->cutter;
    if (t->tear_count > 0) qsort(t->tears, (size_t)t->tear_count, sizeof *t->tears, dgfemi_compare_tears);
    for (int i = 0, end; i < t->tear_count; i = end) {
        dgfemi_skin_vertex v = c->vertices[t->tears[i].vertex];
        int vertex = t->tears[i].vertex, copy = vertex;
        for (end = i + 1; end < t->tear_count && t->tears[end].vertex == vertex &&
                          t->tears[end].location.element == t->tears[i].location.element;)
            end++;
        if (end - i < used[vertex])
            copy = dgfemi_skin_add_vertex(c, v.rest, v.anchor, v.world, vertex, vertex, 0, v.side, v.element);
        if (copy == DGFEM_NONE) return 0;
        for (int k = i; k < end; k++) t->tears[k].copy = copy;
    }
    return 1;
}

/* Vertices of one weld that go to one element stay one weld, without those that stay behind. 1 on success. */
static int dgfemi_skin_weld_torn(dgfemi_skin_tearer *t, dgfemi_arena *arena) {
    dgfemi_skin_vertex *vertices = t->cutter->vertices;
    int count = t->cutter->vertex_count, *first = (int *)dgfemi_arena_allocate(arena, (size_t)count, sizeof(int));
    char *goes = (char *)dgfemi_arena_allocate_zero(arena, (size_t)count, 1);
    if (!first || !goes) return 0;
    for (int v = 0; v < count; v++) first[v] = DGFEM_NONE;
    for (int i = 0; i < t->tear_count; i++) goes[t->tears[i].copy] = 1;
    for (int v = 0; v < count; v++) {
        if (goes[v]) continue;
        if (first[vertices[v].weld] == DGFEM_NONE) first[vertices[v].weld] = v;
        vertices[v].weld = first[vertices[v].weld];
    }
    for (int i = 0, end; i < t->tear_count; i = end) {
        int lowest = t->tears[i].copy;
        for (end = i; end < t->tear_count && t->tears[end].weld == t->tears[i].weld &&
                      t->tears[end].location.element == t->tears[i].location.element;
             end++)
            if (t->tears[end].copy < lowest) lowest = t->tears[end].copy;
        for (int k = i; k < end; k++) vertices[t->tears[k].copy].weld = lowest;
    }
    return 1;
}

/* 1 on success. */
static int dgfemi_skin_apply_tears(dgfemi_skin_tearer *t, dgfemi_arena *arena, int count) {
    dgfemi_skin_cutter *c = t->cutter;
    const dgfem_mesh *mesh = t->locator->mesh;
    dgfemi_places places;
    if (!dgfemi_places_allocate(arena, c->vertex_count, t->places->locator, &places)) return 0;
    memcpy(places.element, t->places->element, (size_t)count * sizeof(int));
    memcpy(places.window, t->places->window, (size_t)count * sizeof(dgfem_vec3));
    for (int i = 0; i < t->tear_count; i++) {
        const dgfemi_skin_tear *tear = &t->tears[i];
        const dgfemi_location *l = &tear->location;
        dgfemi_skin_vertex *v = &c->vertices[tear->copy];
        v->anchor = dgfemi_locate_inside(mesh, l->element, l->nearest);
        places.element[tear->copy] = l->element;
        places.window[tear->copy] = dgfemi_window_position(mesh, l, v->rest);
        c->triangles.data[tear->corner] = tear->copy;
    }
    *t->places = places;
    return 1;
}

/* Only triangles with a corner in an element at a cut (at_cut[elements]) can be torn. 1 on success. */
static int dgfemi_skin_tear_triangles(dgfemi_arena *arena, dgfemi_skin_cutter *c, const dgfemi_locator *locator,
                                      const char *at_cut, dgfemi_places *places) {
    const dgfem_mesh *mesh = locator->mesh;
    size_t elements = (size_t)mesh->element_count;
    int count = c->vertex_count, ok, *used = (int *)dgfemi_arena_allocate_zero(arena, (size_t)count, sizeof(int));
    dgfemi_skin_tearer t;
    memset(&t, 0, sizeof t);
    t.cutter = c, t.locator = locator, t.places = places;
    t.group = (int *)dgfemi_arena_allocate_zero(arena, elements, sizeof(int));
    t.queue = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    ok = used && t.group && t.queue;
    for (int i = 0; ok && i < c->triangles.count; i++) used[c->triangles.data[i]]++;
    for (int i = 0; ok && i < c->triangles.count; i += 3) {
        const int *corner = c->triangles.data + i;
        int a = places->element[corner[0]], b = places->element[corner[1]], d = places->element[corner[2]];
        if (!(at_cut[a] || at_cut[b] || at_cut[d]) || dgfemi_skin_hang_together(mesh, a, b, d)) continue;
        ok = dgfemi_skin_find_tears(&t, i);
    }
    ok = ok && dgfemi_skin_copy_torn(&t, used);
    if (ok && t.tear_count > 0) ok = dgfemi_skin_weld_torn(&t, arena) && dgfemi_skin_apply_tears(&t, arena, count);
    dgfemi_free(c->hooks, t.tears);
    return ok;
}

/* Places of all vertices, and their anchors. The last of several blades (`last`) leaves no triangle across a cut. 1 on
   success, 0 when out of memory. */
static int dgfemi_skin_find_places(dgfemi_arena *arena, dgfemi_skin_cutter *c, int last, dgfemi_places *places) {
    const dgfem_mesh *mesh = c->body->mesh;
    int between = c->skin->embedding->sample_count == 0; /* two blades: the elements are those of this mesh */
    dgfemi_blade_sides sides;
    dgfemi_kinship kinship;
    dgfemi_locator *locator = (dgfemi_locator *)dgfemi_arena_allocate(arena, 1, sizeof *locator);
    if (!locator || !dgfemi_locator_make(arena, mesh, locator) ||
        !dgfemi_places_allocate(arena, c->vertex_count, locator, places) ||
        !dgfemi_skin_find_sides(arena, c, &sides) ||
        (!between && !dgfemi_kinship_make(arena, mesh, c->skin->embedding, &kinship)))
        return 0;
    dgfemi_skin_place(c, &sides, between ? NULL : &kinship, places);
    return !last || dgfemi_skin_tear_triangles(arena, c, locator, sides.at_cut, places);
}

/* ---- the new skin ---- */

/* Arrays of the result that do not depend on the embedding. 1 on success. */
static int dgfemi_skin_result_allocate(const dgfemi_skin_cutter *c, dgfem_skin *out) {
    const dgfem_hooks *hooks = c->hooks;
    size_t vertices = (size_t)c->vertex_count, triangles = (size_t)(c->triangles.count / 3);
    size_t added = vertices - (size_t)c->skin->original_vertex_count;
    out->vertex_count = c->vertex_count, out->triangle_count = c->triangles.count / 3;
    out->original_vertex_count = c->skin->original_vertex_count;
    out->original_triangle_count = c->skin->original_triangle_count;
    out->positions = (dgfem_vec3 *)dgfemi_allocate(hooks, vertices, sizeof(dgfem_vec3));
    out->parents = (int *)dgfemi_allocate(hooks, 2 * added, sizeof(int));
    out->parent_weight = (dgfem_real *)dgfemi_allocate(hooks, added, sizeof(dgfem_real));
    out->weld = (int *)dgfemi_allocate(hooks, vertices, sizeof(int));
    out->anchors = (dgfem_vec3 *)dgfemi_allocate(hooks, vertices, sizeof(dgfem_vec3));
    if (!out->positions || !out->parents || !out->parent_weight || !out->weld || !out->anchors) return 0;
    if (!c->skin->triangles) return 1;
    out->normals = (dgfem_vec3 *)dgfemi_allocate(hooks, vertices, sizeof(dgfem_vec3));
    out->triangles = (int *)dgfemi_duplicate(hooks, c->triangles.data, 3 * triangles, sizeof(int));
    out->source = (int *)dgfemi_allocate(hooks, triangles, sizeof(int));
    out->wall = (int *)dgfemi_allocate(hooks, triangles, sizeof(int));
    return out->normals && out->triangles && out->source && out->wall && dgfemi_skin_make_corners(out);
}

static void dgfemi_skin_result_fill(const dgfemi_skin_cutter *c, dgfem_skin *out) {
    const dgfem_skin *skin = c->skin;
    int original = skin->original_vertex_count, old = skin->vertex_count, walls = c->cap_triangles.count / 3;
    out->cut_count = skin->cut_count + (walls > 0 || c->edges.count > 0);
    for (int v = 0; v < out->vertex_count; v++) {
        const dgfemi_skin_vertex *vertex = &c->vertices[v];
        out->weld[v] = vertex->weld, out->anchors[v] = vertex->anchor;
        if (v < original) continue;
        out->parents[2 * (v - original)] = v < old ? skin->parents[2 * (v - original)] : vertex->parent[0];
        out->parents[2 * (v - original) + 1] = v < old ? skin->parents[2 * (v - original) + 1] : vertex->parent[1];
        out->parent_weight[v - original] = v < old ? skin->parent_weight[v - original] : vertex->weight;
    }
    for (int t = 0; t < out->triangle_count; t++) {
        int part = t < c->part_count;
        out->source[t] = part ? c->parts[t].source : DGFEM_NONE;
        out->wall[t] = part ? c->parts[t].wall : t < c->part_count + walls ? -out->cut_count : out->cut_count;
    }
}

/* Between two blades a skin has no weights: only the places that it was cut in. 1 on success. */
static int dgfemi_skin_keep_places(const dgfemi_skin_cutter *c, const dgfemi_places *places, dgfem_skin *skin) {
    size_t count = (size_t)c->vertex_count;
    skin->embedding = (dgfem_embedding *)dgfemi_allocate_zero(c->hooks, 1, sizeof *skin->embedding);
    if (!skin->embedding) return 0;
    skin->embedding->hooks = *c->hooks;
    skin->embedding->points = (dgfem_vec3 *)dgfemi_allocate(c->hooks, count, sizeof(dgfem_vec3));
    skin->embedding->point_element = (int *)dgfemi_duplicate(c->hooks, places->element, count, sizeof(int));
    skin->embedding->point_window = (dgfem_vec3 *)dgfemi_duplicate(c->hooks, places->window, count, sizeof(dgfem_vec3));
    if (!skin->embedding->points || !skin->embedding->point_element || !skin->embedding->point_window) return 0;
    for (size_t i = 0; i < count; i++) {
        skin->embedding->points[i] = c->vertices[i].rest;
        skin->positions[i] = c->vertices[i].world;
    }
    return 1;
}

static dgfem_status dgfemi_skin_result(dgfemi_skin_cutter *c, const dgfem_embedding *weights, dgfem_skin **out) {
    const dgfem_hooks *hooks = c->hooks;
    dgfemi_arena arena = dgfemi_arena_make(hooks);
    dgfemi_places places;
    dgfem_skin *skin = (dgfem_skin *)dgfemi_allocate_zero(hooks, 1, sizeof *skin);
    dgfem_points_in rest;
    dgfem_status status = DGFEM_OK;
    if (skin) skin->hooks = *hooks;
    if (!skin || !dgfemi_skin_find_places(&arena, c, c->last, &places) || !dgfemi_skin_result_allocate(c, skin))
        status = dgfemi_fail_memory(hooks);
    if (status == DGFEM_OK) dgfemi_skin_result_fill(c, skin);
    if (status == DGFEM_OK && !weights && !dgfemi_skin_keep_places(c, &places, skin))
        status = dgfemi_fail_memory(hooks);
    if (status == DGFEM_OK && weights) {
        rest =
            dgfem_points_in_vec3((const dgfem_vec3 *)(const void *)c->vertices, c->vertex_count); /* its first member */
        rest.stride = (int)sizeof *c->vertices;
        status = dgfemi_skin_embed(skin, c->body, &rest, NULL, &places, weights);
    }
    dgfemi_arena_free(&arena);
    if (status != DGFEM_OK) {
        dgfem_skin_destroy(skin);
        return status;
    }
    if (weights) dgfemi_skin_update(skin, c->body);
    *out = skin;
    return DGFEM_OK;
}

static int dgfemi_skin_list_elements(dgfemi_skin_cutter *c) {
    for (int v = c->element->count; v < c->vertex_count; v++)
        if (!dgfemi_push(c->hooks, c->element, c->vertices[v].element)) return 0;
    return 1;
}

/* A copy of the skin, cut by the blade, the `last` of those that the body was cut by, or not; `body` is the body
   after all its elements were, `before` the one before. `weights` are those of the skin before all blades, of which
   many can be kept; NULL where another blade follows, and the copy can do nothing but be cut again. element: of
   `before`, that carried each vertex; those of new vertices are appended. On failure nothing is made. */
static dgfem_status dgfemi_skin_cut(const dgfem_skin *skin, const dgfem_body *body, const dgfem_body *before,
                                    const dgfemi_blade *blade, int last, const dgfem_embedding *weights,
                                    dgfemi_ints *element, dgfem_skin **out) {
    dgfemi_skin_cutter c;
    dgfem_status status;
    memset(&c, 0, sizeof c);
    c.skin = skin, c.body = body, c.blade = blade, c.hooks = &skin->hooks;
    c.before = before, c.element = element, c.last = last;
    *out = NULL;
    if (!dgfemi_skin_cutter_begin(&c) || !dgfemi_skin_find_layers(&c)) {
        dgfemi_skin_cutter_free(&c);
        return dgfemi_fail_memory(&skin->hooks);
    }
    dgfemi_skin_find_signs(&c);
    if (dgfemi_skin_find_chords(&c) && dgfemi_skin_split_all(&c) && dgfemi_skin_merge_short_edges(&c) &&
        dgfemi_skin_find_slit(&c) &&
        dgfemi_skin_find_caps(&c) && dgfemi_skin_make_vertices(&c) && dgfemi_skin_make_walls(&c) &&
        dgfemi_skin_list_elements(&c))
        status = dgfemi_skin_result(&c, weights, out);
    else status = dgfemi_fail_memory(&skin->hooks);
    dgfemi_skin_cutter_free(&c);
    return status;
}
