#pragma once
#include "renew.c"
/* Adaptive refinement: elements split, their degrees raised, and what was split merged again.

   A split divides one element by planes through its centroid, whatever its neighbours are: a face that only one side
   divides is divided for both, so that there are no hanging nodes to care for.

   The elements that come of one split are a family. A family remembers, as its parent, the family that the split element
   was of. That is all that coarsening needs: when all elements of a family are to be merged and no other family has it
   for a parent, they become one element of the parent family. Cuts and sliver merging may have changed these elements in
   the meantime; then what is left of them is merged as far as it is glued. */

/* Planes, and a plane and a vertex, that differ by less than this times an element's radius are taken for the same. */
#define DGFEM_REFINE_SAME (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-6))

/* ---- hexahedra ---- */

typedef struct dgfemi_hexahedron {
    int count;
    dgfem_plane side[6];  /* the planes of its faces, outward, about the element's centre */
    dgfem_real gap[6][6]; /* [i][k] depth of side k's nearest vertex behind the plane of side i */
} dgfemi_hexahedron;

/* The side in the plane of an element's face; a new one, where there is room, if it is the first face there. */
static int dgfemi_hexahedron_side(dgfemi_hexahedron *h, const dgfem_mesh *mesh, int element, int f) {
    const dgfem_face *face = &mesh->faces[f];
    const dgfem_element *e = &mesh->elements[element];
    dgfem_vec3 normal = dgfemi_scale((dgfem_real)dgfemi_mesh_sign(mesh, element, f), face->normal);
    dgfem_real offset = dgfemi_dot(normal, dgfemi_sub(face->centre, e->centre));
    for (int i = 0; i < h->count; i++)
        if (dgfemi_distance(h->side[i].normal, normal) <= DGFEM_REFINE_SAME &&
            dgfemi_abs(h->side[i].offset - offset) <= DGFEM_REFINE_SAME * e->radius)
            return i;
    if (h->count == 6) return DGFEM_NONE;
    h->side[h->count].normal = normal, h->side[h->count].offset = offset;
    return h->count++;
}

static void dgfemi_hexahedron_add_vertices(dgfemi_hexahedron *h, const dgfem_mesh *mesh, int element, int f, int side) {
    const dgfem_face *face = &mesh->faces[f];
    dgfem_vec3 centre = mesh->elements[element].centre;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
        for (int i = 0; i < mesh->loops[l].count; i++) {
            dgfem_vec3 p = dgfemi_sub(mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]], centre);
            for (int k = 0; k < 6; k++) {
                dgfem_real depth = h->side[k].offset - dgfemi_dot(h->side[k].normal, p);
                h->gap[k][side] = dgfemi_min(h->gap[k][side], depth);
            }
        }
}

/* The only side that does not touch side i, or DGFEM_NONE. */
static int dgfemi_hexahedron_opposite(const dgfemi_hexahedron *h, int i, dgfem_real tolerance) {
    int opposite = DGFEM_NONE;
    for (int k = 0; k < 6; k++) {
        if (!(h->gap[i][k] > tolerance)) continue;
        if (opposite != DGFEM_NONE) return DGFEM_NONE;
        opposite = k;
    }
    return opposite;
}

static int dgfemi_hexahedron_measure(dgfemi_hexahedron *h, const dgfem_mesh *mesh, int element) {
    const dgfem_element *e = &mesh->elements[element];
    memset(h, 0, sizeof *h);
    for (int k = e->face_start; k < e->face_start + e->face_count; k++)
        if (dgfemi_hexahedron_side(h, mesh, element, mesh->element_faces[k]) == DGFEM_NONE) return 0;
    if (h->count != 6) return 0;
    for (int i = 0; i < 36; i++) h->gap[i / 6][i % 6] = 4 * e->radius;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        int f = mesh->element_faces[k];
        dgfemi_hexahedron_add_vertices(h, mesh, element, f, dgfemi_hexahedron_side(h, mesh, element, f));
    }
    return 1;
}

/* The plane through the element's centroid, or through a vertex that is there but for round-off: a neighbour's split. */
static dgfem_plane dgfemi_refine_plane(const dgfem_mesh *mesh, int element, dgfem_vec3 normal) {
    const dgfem_element *e = &mesh->elements[element];
    dgfem_real nearest = DGFEM_REFINE_SAME * e->radius, shift = 0;
    dgfem_plane plane;
    plane.normal = normal;
    plane.offset = dgfemi_dot(normal, e->centre);
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++)
            for (int i = 0; i < mesh->loops[l].count; i++) {
                dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[mesh->loops[l].start + i]];
                dgfem_real distance = dgfemi_dot(normal, dgfemi_sub(p, e->centre));
                if (dgfemi_abs(distance) < nearest) nearest = dgfemi_abs(distance), shift = distance;
            }
    }
    plane.offset += shift;
    return plane;
}

/* The three middle planes of a hexahedron: an element whose faces lie in six planes and bound a convex body of which
   each side touches all others but one. 0: it is none. */
static int dgfemi_hexahedron_planes(const dgfem_mesh *mesh, int element, dgfem_plane planes[3]) {
    dgfemi_hexahedron h;
    dgfem_real tolerance = DGFEM_REFINE_SAME * mesh->elements[element].radius;
    int count = 0;
    if (!dgfemi_hexahedron_measure(&h, mesh, element)) return 0;
    for (int i = 0; i < 36; i++)
        if (!(h.gap[i / 6][i % 6] >= -tolerance)) return 0;
    for (int i = 0; i < 6; i++) {
        int k = dgfemi_hexahedron_opposite(&h, i, tolerance);
        if (k == DGFEM_NONE || dgfemi_hexahedron_opposite(&h, k, tolerance) != i) return 0;
        if (i > k) continue;
        dgfem_vec3 across = dgfemi_sub(h.side[i].normal, h.side[k].normal);
        planes[count++] = dgfemi_refine_plane(mesh, element, dgfemi_normalized(across));
    }
    return 1;
}

/* ---- splitting ---- */

typedef struct dgfemi_refiner {
    dgfemi_edit *edit;
    dgfemi_splitter splitter;
    dgfemi_ints parts, next; /* of the element at work */
} dgfemi_refiner;

static void dgfemi_refiner_make(dgfemi_refiner *refiner, dgfemi_edit *edit) {
    memset(refiner, 0, sizeof *refiner);
    refiner->edit = edit;
    refiner->splitter = dgfemi_splitter_make(edit->mesh);
    refiner->splitter.components = refiner->splitter.measure = refiner->splitter.local = 1;
}

static void dgfemi_refiner_free(dgfemi_refiner *refiner) {
    const dgfem_hooks *hooks = &refiner->edit->body->hooks;
    dgfemi_splitter_free(&refiner->splitter);
    dgfemi_free(hooks, refiner->parts.data);
    dgfemi_free(hooks, refiner->next.data);
}

/* Splits elements by one plane, silently unless out of memory: other failures have a way out. Appends to `next` what
   they are then. */
static dgfem_status dgfemi_refiner_try(dgfemi_refiner *refiner, const int *elements, int count, dgfem_plane plane) {
    dgfem_mesh *mesh = refiner->edit->mesh;
    dgfemi_splitter *s = &refiner->splitter;
    dgfem_hooks hooks = mesh->hooks;
    mesh->hooks.log = NULL;
    dgfem_status status = dgfemi_split_elements(s, plane, elements, count);
    mesh->hooks.log = hooks.log;
    if (status) return status == DGFEM_ERROR_MEMORY ? dgfemi_fail_memory(&hooks) : status;
    int ok = 1;
    for (int i = 0, k = 0; ok && i < count; i++) {
        if (k < s->selected.count && s->selected.data[k] == elements[i]) k++;
        else ok = dgfemi_push(&hooks, &refiner->next, elements[i]);
    }
    for (int c = 0; ok && c < s->child_count; c++)
        if (s->children[c].side != 0) ok = dgfemi_push(&hooks, &refiner->next, s->children[c].element);
    return ok ? DGFEM_OK : dgfemi_fail_memory(&hooks);
}

/* One element on its own. Where round-off lets it not be split the plane gives way a little; at last it stays whole. */
static dgfem_status dgfemi_refiner_split_alone(dgfemi_refiner *refiner, int element, dgfem_plane plane) {
    static const double shifts[] = {0, 1e-4, -1e-4, 1e-2, -1e-2};
    dgfem_real radius = refiner->edit->mesh->elements[element].radius;
    for (size_t i = 0; i < sizeof shifts / sizeof *shifts; i++) {
        dgfem_plane shifted = plane;
        shifted.offset += (dgfem_real)shifts[i] * radius;
        dgfem_status status = dgfemi_refiner_try(refiner, &element, 1, shifted);
        if (!status || status == DGFEM_ERROR_MEMORY) return status;
    }
    if (!dgfemi_push(&refiner->edit->body->hooks, &refiner->next, element))
        return dgfemi_fail_memory(&refiner->edit->body->hooks);
    return DGFEM_OK;
}

/* Splits all of `parts` by a plane with unit normal, and lists what they are then. */
static dgfem_status dgfemi_refiner_split(dgfemi_refiner *refiner, dgfem_plane plane) {
    refiner->next.count = 0;
    dgfem_status status = dgfemi_refiner_try(refiner, refiner->parts.data, refiner->parts.count, plane);
    if (status && status != DGFEM_ERROR_MEMORY) {
        refiner->next.count = 0;
        status = DGFEM_OK;
        for (int i = 0; !status && i < refiner->parts.count; i++)
            status = dgfemi_refiner_split_alone(refiner, refiner->parts.data[i], plane);
    }
    dgfemi_ints parts = refiner->parts;
    refiner->parts = refiner->next;
    refiner->next = parts;
    return status;
}

/* Splits an element of the edit's mesh by several planes; `parts` are what it is then: more than one unless it could not
   be split. They become a family. */
static dgfem_status dgfemi_refiner_divide(dgfemi_refiner *refiner, int element, const dgfem_plane *planes, int count) {
    const dgfem_hooks *hooks = &refiner->edit->body->hooks;
    dgfemi_edit *edit = refiner->edit;
    dgfem_status status = DGFEM_OK;
    refiner->parts.count = 0;
    if (!dgfemi_push(hooks, &refiner->parts, element)) return dgfemi_fail_memory(hooks);
    for (int i = 0; !status && i < count; i++) status = dgfemi_refiner_split(refiner, planes[i]);
    if (status || refiner->parts.count == 1) return status;
    dgfemi_field *field = &edit->fields[edit->mesh->elements[element].tag];
    if (!dgfemi_push(hooks, &edit->families, field->family)) return dgfemi_fail_memory(hooks);
    field->family = edit->families.count - 1;
    return DGFEM_OK;
}

/* ---- stress ---- */

/* Principal values of an element's mean stress, ascending, and their directions in the material. */
static void dgfemi_refine_principal(const dgfem_body *body, int element, dgfem_real values[3], dgfem_mat3 *directions) {
    dgfem_mat3 f = dgfemi_mean_gradient(body, element), r = dgfemi_rotation_now(body, element), world;
    dgfem_mat3 turned = dgfemi_transposed(&r);
    dgfem_eigen_symmetric(dgfemi_stress_of(body, element, &f), values, &world);
    *directions = dgfemi_multiply3(&turned, &world);
}

static dgfem_real dgfemi_refine_stress(const dgfem_body *body, int element) {
    dgfem_mat3 directions;
    dgfem_real values[3];
    dgfemi_refine_principal(body, element, values, &directions);
    return dgfemi_max(dgfemi_abs(values[0]), dgfemi_abs(values[2]));
}

/* The rest direction across which an element is halved; without stress, that of its bounding box's longest edge. */
static dgfem_vec3 dgfemi_refine_direction(const dgfem_body *body, int element) {
    dgfem_mat3 directions;
    dgfem_real values[3];
    dgfem_vec3 lower, upper, size;
    dgfemi_refine_principal(body, element, values, &directions);
    dgfem_real largest = dgfemi_max(dgfemi_abs(values[0]), dgfemi_abs(values[2]));
    if (largest > 1000 * DGFEM_EPSILON * body->material[element].young)
        return dgfemi_normalized(dgfemi_column(&directions, dgfemi_abs(values[0]) > dgfemi_abs(values[2]) ? 0 : 2));
    dgfemi_mesh_element_box(body->mesh, element, &lower, &upper);
    size = dgfemi_sub(upper, lower);
    return dgfemi_vec3(size.x >= size.y && size.x >= size.z, size.y > size.x && size.y >= size.z,
                       size.z > size.x && size.z > size.y);
}

/* ---- what is to be done ---- */

static dgfem_status dgfemi_refine_choose(const dgfem_body *body, const dgfem_refine_desc *desc, int element,
                                         dgfem_real stress, dgfem_refine_action *action) {
    *action = DGFEM_REFINE_NONE;
    if (stress > desc->refine_above) *action = desc->how;
    else if (stress < desc->merge_below)
        *action = desc->how == DGFEM_REFINE_RAISE ? DGFEM_REFINE_LOWER : DGFEM_REFINE_MERGE;
    if (desc->choose) *action = desc->choose(desc->user, body, element, *action);
    if ((int)*action >= 0 && *action <= DGFEM_REFINE_MERGE) return DGFEM_OK;
    return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "refine: unknown action %d for element %d", (int)*action,
                       element);
}

static dgfem_status dgfemi_refine_choose_all(const dgfem_body *body, const dgfem_refine_desc *desc,
                                             dgfem_refine_action *actions, dgfem_refine_info *info) {
    dgfem_status status = DGFEM_OK;
    for (int e = 0; !status && e < body->mesh->element_count; e++) {
        dgfem_real stress = dgfemi_refine_stress(body, e);
        info->largest_stress = dgfemi_max(stress, info->largest_stress);
        status = dgfemi_refine_choose(body, desc, e, stress, &actions[e]);
    }
    return status;
}

static void dgfemi_refine_degrees(dgfemi_edit *edit, const dgfem_refine_desc *desc, const dgfem_refine_action *actions,
                                  dgfem_refine_info *info) {
    for (int e = 0; e < edit->body->mesh->element_count; e++) {
        dgfemi_field *field = &edit->fields[e];
        if (actions[e] == DGFEM_REFINE_RAISE && field->degree < desc->highest_degree)
            field->next_degree++, info->degrees_raised++;
        if (actions[e] == DGFEM_REFINE_LOWER && field->degree > desc->lowest_degree)
            field->next_degree--, info->degrees_lowered++;
    }
}

static dgfem_status dgfemi_refine_split(dgfemi_refiner *refiner, const dgfem_refine_desc *desc,
                                        dgfem_refine_action action, int element, dgfem_refine_info *info) {
    const dgfem_mesh *mesh = refiner->edit->mesh;
    dgfem_real smallest = desc->smallest * desc->smallest * desc->smallest;
    dgfem_plane planes[3];
    int count = action == DGFEM_REFINE_EIGHT && dgfemi_hexahedron_planes(mesh, element, planes) ? 3 : 1;
    if (mesh->elements[element].volume < (count == 3 ? 8 : 2) * smallest) return DGFEM_OK;
    if (count == 1)
        planes[0] = dgfemi_refine_plane(mesh, element, dgfemi_refine_direction(refiner->edit->body, element));
    dgfem_status status = dgfemi_refiner_divide(refiner, element, planes, count);
    info->elements_split += refiner->parts.count > 1;
    return status;
}

static dgfem_status dgfemi_refine_split_all(dgfemi_edit *edit, const dgfem_refine_desc *desc,
                                            const dgfem_refine_action *actions, dgfem_refine_info *info) {
    dgfemi_refiner refiner;
    dgfem_status status = DGFEM_OK;
    dgfemi_refiner_make(&refiner, edit);
    for (int e = 0; !status && e < edit->body->mesh->element_count; e++)
        if (actions[e] == DGFEM_REFINE_EIGHT || actions[e] == DGFEM_REFINE_TWO)
            status = dgfemi_refine_split(&refiner, desc, actions[e], e, info);
    dgfemi_refiner_free(&refiner);
    return status;
}

/* ---- merging families ---- */

/* Marks the families that are to be merged: all of their elements are, and may be, and no family came of one of them.
   first[families]: the first element of each. Returns their number. */
static int dgfemi_refine_mark_families(const dgfemi_edit *edit, const dgfem_refine_action *actions, char *merging,
                                       int *first) {
    const dgfem_body *body = edit->body;
    int count = 0;
    for (int k = 0; k < body->family_count; k++) merging[k] = 1, first[k] = DGFEM_NONE;
    for (int k = 0; k < body->family_count; k++)
        if (body->family_parent[k] != DGFEM_NONE) merging[body->family_parent[k]] = 0;
    for (int e = 0; body->family && e < body->mesh->element_count; e++) {
        int k = body->family[e];
        if (k == DGFEM_NONE) continue;
        if (first[k] == DGFEM_NONE) first[k] = e;
        if (actions[e] != DGFEM_REFINE_MERGE || !dgfemi_edit_allows(edit, first[k], e)) merging[k] = 0;
    }
    for (int k = 0; k < body->family_count; k++) count += merging[k];
    return count;
}

static int dgfemi_refine_allows(const void *user, int a, int b) {
    const dgfemi_edit *edit = (const dgfemi_edit *)user;
    return edit->fields[a].family == edit->fields[b].family && dgfemi_edit_allows(user, a, b);
}

/* Merges each family that is marked, and gives it the number of its parent. */
static dgfem_status dgfemi_refine_merge(dgfemi_edit *edit, dgfemi_arena *arena, const char *merging,
                                        dgfem_refine_info *info) {
    const dgfem_mesh *mesh = edit->mesh;
    dgfemi_merge_rule rule;
    memset(&rule, 0, sizeof rule);
    char *candidate = (char *)dgfemi_arena_allocate(arena, (size_t)mesh->element_count, 1);
    if (!candidate) return dgfemi_fail_memory(&edit->body->hooks);
    for (int e = 0; e < mesh->element_count; e++) {
        int k = edit->fields[mesh->elements[e].tag].family;
        candidate[e] = k != DGFEM_NONE && k < edit->body->family_count && merging[k];
    }
    rule.candidate = candidate;
    rule.allows = dgfemi_refine_allows;
    rule.volume = DGFEM_R(HUGE_VAL);
    dgfem_status status = dgfemi_edit_merge_by(edit, &rule, 0, &info->elements_merged);
    for (int f = 0; !status && f < edit->field_count; f++) {
        int k = edit->fields[f].family;
        if (k != DGFEM_NONE && k < edit->body->family_count && merging[k])
            edit->fields[f].family = edit->families.data[k];
    }
    return status;
}

static dgfem_status dgfemi_refine_merge_all(dgfemi_edit *edit, const dgfem_refine_action *actions, int *families,
                                            dgfem_refine_info *info) {
    dgfemi_arena arena = dgfemi_arena_make(&edit->body->hooks);
    size_t count = (size_t)edit->body->family_count;
    char *merging = (char *)dgfemi_arena_allocate(&arena, count, 1);
    int *first = (int *)dgfemi_arena_allocate(&arena, count, sizeof(int));
    dgfem_status status = merging && first ? DGFEM_OK : dgfemi_fail_memory(&edit->body->hooks);
    *families = status ? 0 : dgfemi_refine_mark_families(edit, actions, merging, first);
    if (*families > 0) status = dgfemi_refine_merge(edit, &arena, merging, info);
    dgfemi_arena_free(&arena);
    return status;
}

/* ---- the call ---- */

DGFEM_API dgfem_refine_desc dgfem_default_refine_desc(void) {
    dgfem_refine_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.how = DGFEM_REFINE_EIGHT;
    desc.refine_above = DGFEM_R(HUGE_VAL);
    desc.highest_degree = DGFEM_MAX_DEGREE;
    desc.lowest_degree = 1;
    return desc;
}

static dgfem_status dgfemi_check_refine(const dgfem_body *body, const dgfem_refine_desc *desc) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_status status = dgfemi_check_desc(hooks, desc, desc ? desc->cookie : 0, "refine");
    if (status) return status;
    if ((int)desc->how < (int)DGFEM_REFINE_EIGHT || desc->how > DGFEM_REFINE_RAISE)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "refine: `how` is %d", (int)desc->how);
    if (!(desc->merge_below >= 0 && desc->merge_below <= desc->refine_above))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "refine: merge_below is %g, expected in [0, refine_above = %g]",
                           (double)desc->merge_below, (double)desc->refine_above);
    if (desc->lowest_degree < 1 || desc->highest_degree > DGFEM_MAX_DEGREE ||
        desc->lowest_degree > desc->highest_degree)
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "refine: degrees from %d to %d, expected in 1..%d",
                           desc->lowest_degree, desc->highest_degree, DGFEM_MAX_DEGREE);
    return dgfemi_check_not_negative(hooks, desc->smallest, "refine: smallest");
}

static dgfem_status dgfemi_body_refine(dgfem_body *body, const dgfem_refine_desc *desc,
                                       const dgfem_refine_action *actions, dgfem_refine_info *info) {
    dgfemi_edit edit;
    int families = 0;
    dgfem_status status = dgfemi_edit_begin(&edit, body);
    if (status) return status;
    dgfemi_refine_degrees(&edit, desc, actions, info);
    status = dgfemi_refine_split_all(&edit, desc, actions, info);
    if (!status) status = dgfemi_refine_merge_all(&edit, actions, &families, info);
    int changes = info->elements_split + families + info->degrees_raised + info->degrees_lowered;
    if (!status && changes > 0) status = dgfemi_edit_finish(&edit, body);
    dgfemi_edit_free(&edit);
    return status;
}

DGFEM_API dgfem_status dgfem_body_refine(dgfem_body *body, const dgfem_refine_desc *desc, dgfem_refine_info *info) {
    dgfem_refine_info done;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfemi_check_refine(body, desc);
    if (status) return status;
    memset(&done, 0, sizeof done);
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    dgfem_refine_action *actions =
        (dgfem_refine_action *)dgfemi_arena_allocate(&arena, (size_t)body->mesh->element_count, sizeof *actions);
    status = actions ? dgfemi_refine_choose_all(body, desc, actions, &done) : dgfemi_fail_memory(&body->hooks);
    if (!status) status = dgfemi_body_refine(body, desc, actions, &done);
    dgfemi_arena_free(&arena);
    if (!status && info) *info = done;
    return status;
}

/* ---- slivers ---- */

DGFEM_API dgfem_status dgfem_body_merge_slivers(dgfem_body *body, dgfem_real ratio, int *merged) {
    dgfemi_edit edit;
    int count = 0;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!(ratio >= 0 && ratio < 1))
        return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "merge slivers: ratio is %g, expected in [0, 1)",
                           (double)ratio);
    dgfem_status status = dgfemi_edit_begin(&edit, body);
    if (status) return status;
    if (ratio > 0) status = dgfemi_edit_merge(&edit, ratio, 0, 1, &count);
    if (!status && count > 0) status = dgfemi_edit_finish(&edit, body);
    dgfemi_edit_free(&edit);
    if (!status && merged) *merged = count;
    return status;
}
