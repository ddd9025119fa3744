#pragma once
#include "load.c"
#include "locate.c"
#include "mesh_merge.c"
#include "split.c"
/* Editing a body, first half: a copy of the mesh whose elements remember which polynomial they carry.

   Cuts, fracture, refinement and merging have one course: an edit takes a copy of the mesh, changes it as often as
   needed, and renew.c then makes of it all that the body needs, takes over what did not change, and swaps. Until that
   swap, which cannot fail, the body is what it was.

   In between no coefficient moves. At first every element has a field, its polynomial. The parts of an element share its
   field, in the old centre and scale; a union of several has a new one, their L2 projection, which keeps momentum. While
   the edit lasts, tags of elements hold their fields (parts inherit them) and tags of faces hold the body's face that
   they are a part of, or DGFEM_NONE for new ones. */

typedef struct dgfemi_field {
    int source; /* the body's element whose polynomial it is, or DGFEM_NONE: a union's */
    int degree;
    int next_degree;   /* that the elements are to have */
    dgfem_vec3 origin; /* of the polynomial */
    dgfem_real scale;
    int first;        /* union: its coefficients in edit.displacement and edit.velocity */
    int member_start; /* union: range of edit.members, the body's elements that it has parts of */
    int member_count;
    int family;  /* of its elements, in edit.families, or DGFEM_NONE */
    int divided; /* 1: its region has been split, and a part of it may have gone into a union */
} dgfemi_field;

typedef struct dgfemi_vectors {
    dgfem_vec3 *data;
    int count, capacity;
} dgfemi_vectors;

typedef struct dgfemi_edit {
    const dgfem_body *body;
    dgfem_mesh *mesh;
    dgfemi_field *fields;
    int field_count, field_capacity;
    dgfemi_ints members;
    dgfemi_vectors displacement, velocity; /* of unions */
    dgfemi_ints families; /* the family of the element that each family was split from; begins with the body's */
    uint64_t *bond;       /* [the body's elements] equal where conditions allow that elements merge; 0: held, never */
} dgfemi_edit;

static void dgfemi_edit_free(dgfemi_edit *edit) {
    const dgfem_hooks *hooks = &edit->body->hooks;
    dgfem_mesh_destroy(edit->mesh);
    dgfemi_free(hooks, edit->fields);
    dgfemi_free(hooks, edit->members.data);
    dgfemi_free(hooks, edit->displacement.data);
    dgfemi_free(hooks, edit->velocity.data);
    dgfemi_free(hooks, edit->families.data);
    dgfemi_free(hooks, edit->bond);
}

/* Elements merge where the same conditions act on both: held ones never do. */
static int dgfemi_edit_make_bonds(dgfemi_edit *edit) {
    const dgfem_body *body = edit->body;
    size_t n = (size_t)body->mesh->element_count;
    edit->bond = (uint64_t *)dgfemi_allocate(&body->hooks, n, sizeof *edit->bond);
    if (!edit->bond) return 0;
    for (size_t e = 0; e < n; e++) edit->bond[e] = 1;
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        for (int i = 0; condition->kind == DGFEM_CONDITION_BODY_FORCE && i < condition->count; i++)
            edit->bond[condition->items[i]] = dgfemi_mix(edit->bond[condition->items[i]] + (uint64_t)condition->id) | 1;
    }
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        for (int i = 0; condition->kind == DGFEM_CONDITION_FIX_ELEMENTS && i < condition->count; i++)
            edit->bond[condition->items[i]] = 0;
    }
    return 1;
}

static int dgfemi_edit_copy_families(dgfemi_edit *edit) {
    const dgfem_body *body = edit->body;
    if (body->family_count == 0) return 1;
    edit->families.data =
        (int *)dgfemi_duplicate(&body->hooks, body->family_parent, (size_t)body->family_count, sizeof(int));
    if (!edit->families.data) return 0;
    edit->families.count = edit->families.capacity = body->family_count;
    return 1;
}

/* Starts an edit; on failure there is nothing to free. */
static dgfem_status dgfemi_edit_begin(dgfemi_edit *edit, const dgfem_body *body) {
    int count = body->mesh->element_count;
    memset(edit, 0, sizeof *edit);
    edit->body = body;
    edit->mesh = dgfemi_mesh_duplicate(body->mesh);
    edit->fields = (dgfemi_field *)dgfemi_allocate_zero(&body->hooks, (size_t)count, sizeof *edit->fields);
    if (!edit->mesh || !edit->fields || !dgfemi_edit_make_bonds(edit) || !dgfemi_edit_copy_families(edit)) {
        dgfemi_edit_free(edit);
        return dgfemi_fail_memory(&body->hooks);
    }
    edit->field_count = edit->field_capacity = count;
    for (int e = 0; e < count; e++) {
        dgfemi_field *field = &edit->fields[e];
        field->source = e;
        field->degree = field->next_degree = body->degree[e];
        field->origin = body->origin[e];
        field->scale = body->scale[e];
        field->family = body->family ? body->family[e] : DGFEM_NONE;
        edit->mesh->elements[e].tag = e;
    }
    for (int f = 0; f < body->mesh->face_count; f++) edit->mesh->faces[f].tag = f;
    return DGFEM_OK;
}

/* ---- fields ---- */

static const dgfem_vec3 *dgfemi_field_displacement(const dgfemi_edit *edit, const dgfemi_field *field) {
    if (field->source == DGFEM_NONE) return edit->displacement.data + field->first;
    return edit->body->displacement + edit->body->basis_start[field->source];
}

static const dgfem_vec3 *dgfemi_field_velocity(const dgfemi_edit *edit, const dgfemi_field *field) {
    if (field->source == DGFEM_NONE) return edit->velocity.data + field->first;
    return edit->body->velocity + edit->body->basis_start[field->source];
}

/* A body's element that stands for the field: its material, its rotation. */
static int dgfemi_field_element(const dgfemi_edit *edit, const dgfemi_field *field) {
    return field->source == DGFEM_NONE ? edit->members.data[field->member_start] : field->source;
}

/* World position of a rest position, and the deformation gradient there (NULL: not wanted). */
static dgfem_vec3 dgfemi_field_map(const dgfemi_edit *edit, const dgfemi_field *field, dgfem_vec3 x, dgfem_mat3 *f) {
    const dgfem_vec3 *u = dgfemi_field_displacement(edit, field);
    int n = dgfem_monomial_count(field->degree);
    dgfem_real values[DGFEM_MAX_BASIS];
    dgfem_vec3 gradients[DGFEM_MAX_BASIS], place = x;
    dgfemi_basis_evaluate(field->degree, field->origin, field->scale, x, values);
    for (int i = 0; i < n; i++) place = dgfemi_add_scaled(place, values[i], u[i]);
    if (!f) return place;
    *f = dgfemi_identity();
    dgfemi_basis_gradients(field->degree, field->origin, field->scale, x, gradients);
    for (int i = 1; i < n; i++) dgfemi_add_outer(f, 1, u[i], gradients[i]);
    return place;
}

static const dgfemi_field *dgfemi_field_of(const dgfemi_edit *edit, int element) {
    return &edit->fields[edit->mesh->elements[element].tag];
}

/* out = the polynomial `in` of degree p about (c, s), written about (c_new, s_new). Not in place. */
static void dgfemi_move_polynomial(int degree, dgfem_vec3 c, dgfem_real s, const dgfem_vec3 *in, dgfem_vec3 c_new,
                                   dgfem_real s_new, dgfem_vec3 *out) {
    dgfem_real t[DGFEM_MAX_BASIS * DGFEM_MAX_BASIS];
    int n = dgfem_monomial_count(degree);
    dgfemi_basis_shift(degree, c, s, c_new, s_new, t);
    memset(out, 0, (size_t)n * sizeof *out);
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++) out[k] = dgfemi_add_scaled(out[k], t[i * n + k], in[i]);
}

/* ---- unions ---- */

static int dgfemi_vectors_push(const dgfem_hooks *hooks, dgfemi_vectors *vectors, const dgfem_vec3 *data, int count) {
    void *room = vectors->data;
    int ok = dgfemi_mesh_room(hooks, &room, vectors->count, &vectors->capacity, count, sizeof(dgfem_vec3));
    vectors->data = (dgfem_vec3 *)room;
    if (!ok) return 0;
    memcpy(vectors->data + vectors->count, data, (size_t)count * sizeof *data);
    vectors->count += count;
    return 1;
}

/* Whether elements with these fields may become one: same material, same degree, same conditions. */
static int dgfemi_edit_allows(const void *user, int a, int b) {
    const dgfemi_edit *edit = (const dgfemi_edit *)user;
    const dgfemi_field *p = &edit->fields[a], *q = &edit->fields[b];
    int e = dgfemi_field_element(edit, p), f = dgfemi_field_element(edit, q);
    return p->degree == q->degree && p->next_degree == q->next_degree && edit->bond[e] != 0 &&
           edit->bond[e] == edit->bond[f] &&
           memcmp(&edit->body->material[e], &edit->body->material[f], sizeof(dgfem_material)) == 0;
}

/* Adds the body's elements of one field to edit->members, each once per union. 1 on success. */
static int dgfemi_edit_add_members(dgfemi_edit *edit, const dgfemi_field *field, int start) {
    int count = field->source == DGFEM_NONE ? field->member_count : 1;
    for (int i = 0; i < count; i++) {
        int member = field->source == DGFEM_NONE ? edit->members.data[field->member_start + i] : field->source, k;
        for (k = start; k < edit->members.count && edit->members.data[k] != member; k++) {
        }
        if (k == edit->members.count && !dgfemi_push(&edit->body->hooks, &edit->members, member)) return 0;
    }
    return 1;
}

/* Sums of M_m (member's matrix, about the union's centre) and M_m u_m. */
typedef struct dgfemi_projection {
    int degree, count;
    dgfem_vec3 origin;
    dgfem_real scale;
    dgfem_real mass[DGFEM_MAX_BASIS * DGFEM_MAX_BASIS];
    dgfem_vec3 displacement[DGFEM_MAX_BASIS], velocity[DGFEM_MAX_BASIS];
} dgfemi_projection;

static void dgfemi_projection_add(dgfemi_projection *projection, const dgfemi_edit *edit, const dgfem_mesh *mesh,
                                  int element) {
    const dgfemi_field *field = &edit->fields[mesh->elements[element].tag];
    int n = projection->count;
    dgfem_real moments[DGFEM_MAX_MOMENTS];
    dgfem_vec3 u[DGFEM_MAX_BASIS], v[DGFEM_MAX_BASIS];
    dgfemi_element_moments(mesh, element, 2 * projection->degree, projection->origin, projection->scale, moments);
    dgfemi_move_polynomial(field->degree, field->origin, field->scale, dgfemi_field_displacement(edit, field),
                           projection->origin, projection->scale, u);
    dgfemi_move_polynomial(field->degree, field->origin, field->scale, dgfemi_field_velocity(edit, field),
                           projection->origin, projection->scale, v);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            dgfem_real m = moments[dgfemi_product_index(i, j)];
            projection->mass[i * n + j] += m;
            projection->displacement[i] = dgfemi_add_scaled(projection->displacement[i], m, u[j]);
            projection->velocity[i] = dgfemi_add_scaled(projection->velocity[i], m, v[j]);
        }
}

/* The family of the largest one of some elements. */
static int dgfemi_edit_family_of(const dgfemi_edit *edit, const int *elements, int count) {
    const dgfem_element *largest = &edit->mesh->elements[elements[0]];
    for (int i = 1; i < count; i++)
        if (edit->mesh->elements[elements[i]].volume > largest->volume) largest = &edit->mesh->elements[elements[i]];
    return edit->fields[largest->tag].family;
}

/* Makes the field of the union `element` of the merged mesh, whose members are listed (elements of edit->mesh), and
   gives the element its tag. */
static dgfem_status dgfemi_edit_add_union(dgfemi_edit *edit, dgfem_mesh *merged, int element, const int *members,
                                          int count) {
    const dgfem_hooks *hooks = &edit->body->hooks;
    dgfemi_projection projection;
    dgfemi_field field = edit->fields[edit->mesh->elements[members[0]].tag];
    memset(&projection, 0, sizeof projection);
    projection.degree = field.degree, projection.count = dgfem_monomial_count(field.degree);
    projection.origin = merged->elements[element].centre, projection.scale = merged->elements[element].radius;
    for (int i = 0; i < count; i++) dgfemi_projection_add(&projection, edit, edit->mesh, members[i]);
    if (!dgfemi_cholesky_dense(projection.mass, projection.count))
        return dgfemi_fail(hooks, DGFEM_ERROR_DEGENERATE, "element %d: too thin for its polynomials", element);
    dgfemi_cholesky_dense_solve(projection.mass, projection.count, (dgfem_real *)(void *)projection.displacement, 3);
    dgfemi_cholesky_dense_solve(projection.mass, projection.count, (dgfem_real *)(void *)projection.velocity, 3);
    int start = edit->members.count;
    for (int i = 0; i < count; i++)
        if (!dgfemi_edit_add_members(edit, &edit->fields[edit->mesh->elements[members[i]].tag], start))
            return dgfemi_fail_memory(hooks);
    field.source = DGFEM_NONE;
    field.divided = 1;
    field.origin = projection.origin, field.scale = projection.scale;
    field.first = edit->displacement.count;
    field.family = dgfemi_edit_family_of(edit, members, count);
    field.member_start = start, field.member_count = edit->members.count - start;
    if (edit->field_count == edit->field_capacity) {
        void *grown = dgfemi_grow(hooks, edit->fields, &edit->field_capacity, edit->field_count + 1, sizeof field);
        if (!grown) return dgfemi_fail_memory(hooks);
        edit->fields = (dgfemi_field *)grown;
    }
    if (!dgfemi_vectors_push(hooks, &edit->displacement, projection.displacement, projection.count) ||
        !dgfemi_vectors_push(hooks, &edit->velocity, projection.velocity, projection.count))
        return dgfemi_fail_memory(hooks);
    merged->elements[element].tag = edit->field_count;
    edit->fields[edit->field_count++] = field;
    return DGFEM_OK;
}

/* Lists the members of every union, sorted by union, and makes their fields. union_of[e] is the element that took e in,
   directly, or DGFEM_NONE. */
static dgfem_status dgfemi_edit_add_unions(dgfemi_edit *edit, dgfem_mesh *merged, int *union_of, int *start,
                                           int *members) {
    int n = merged->element_count;
    for (int e = 0; e < n; e++) {
        int root = e;
        while (union_of[root] != DGFEM_NONE) root = union_of[root];
        start[root + 1]++;
    }
    for (int e = 0; e < n; e++) start[e + 1] += start[e];
    for (int e = n - 1; e >= 0; e--) { /* start[root] becomes the end, then, filled backwards, the start again */
        int root = e;
        while (union_of[root] != DGFEM_NONE) root = union_of[root];
        members[--start[root + 1]] = e;
    }
    for (int e = 0; e < n; e++) {
        int first = start[e + 1], end = e + 1 < n ? start[e + 2] : n, largest = first;
        if (end - first < 2) continue;
        for (int i = first + 1; i < end; i++) /* comes first: the union takes tag, material and rotation from it */
            if (edit->mesh->elements[members[i]].volume > edit->mesh->elements[members[largest]].volume) largest = i;
        int member = members[largest];
        members[largest] = members[first], members[first] = member;
        dgfem_status status = dgfemi_edit_add_union(edit, merged, e, members + first, end - first);
        if (status) return status;
    }
    return DGFEM_OK;
}

/* Marks the fields that several elements share, and in parts[elements] those elements (1, else 0). */
static int dgfemi_edit_mark_parts(dgfemi_edit *edit, char *parts) {
    const dgfem_mesh *mesh = edit->mesh;
    int *use = (int *)dgfemi_allocate_zero(&edit->body->hooks, (size_t)edit->field_count, sizeof(int));
    if (!use) return 0;
    for (int e = 0; e < mesh->element_count; e++)
        if (mesh->elements[e].face_count > 0) use[mesh->elements[e].tag]++;
    for (int f = 0; f < edit->field_count; f++) edit->fields[f].divided |= use[f] > 1;
    for (int e = 0; e < mesh->element_count; e++)
        parts[e] = mesh->elements[e].face_count > 0 && edit->fields[mesh->elements[e].tag].divided;
    dgfemi_free(&edit->body->hooks, use);
    return 1;
}

/* Runs the merger on a copy of the mesh and makes the fields of the unions. */
static dgfem_status dgfemi_edit_run_merger(dgfemi_edit *edit, dgfemi_merger *merger, dgfemi_arena *arena, int *merged) {
    const dgfem_hooks *hooks = &edit->body->hooks;
    dgfem_status status = DGFEM_OK;
    int n = edit->mesh->element_count, left = 0;
    int *union_of = (int *)dgfemi_arena_allocate(arena, (size_t)n, sizeof(int));
    int *start = (int *)dgfemi_arena_allocate_zero(arena, (size_t)n + 2, sizeof(int));
    int *members = (int *)dgfemi_arena_allocate(arena, (size_t)n, sizeof(int));
    merger->mesh = dgfemi_mesh_duplicate(edit->mesh);
    merger->union_of = union_of;
    if (!union_of || !start || !members || !merger->mesh) status = dgfemi_fail_memory(hooks);
    for (int e = 0; !status && e < n; e++) union_of[e] = DGFEM_NONE;
    if (!status && !dgfemi_merger_run(merger, merged, &left)) status = dgfemi_fail_memory(hooks);
    if (!status && *merged > 0) status = dgfemi_edit_add_unions(edit, merger->mesh, union_of, start, members);
    if (!status) dgfemi_mesh_swap(edit->mesh, merger->mesh);
    dgfem_mesh_destroy(merger->mesh);
    return status;
}

/* Merges what the rule calls slivers, and counts them. The rule's candidates, where it has none, are the parts of elements
   that were split (all: all elements); `allows` gets the edit as user, and fields. */
static dgfem_status dgfemi_edit_merge_by(dgfemi_edit *edit, const dgfemi_merge_rule *rule, int all, int *merged) {
    const dgfem_hooks *hooks = &edit->body->hooks;
    dgfemi_arena arena = dgfemi_arena_make(hooks);
    dgfemi_merger merger;
    dgfem_status status = DGFEM_OK;
    memset(&merger, 0, sizeof merger);
    merger.rule = *rule;
    merger.rule.user = edit;
    *merged = 0;
    char *parts = (char *)dgfemi_arena_allocate(&arena, (size_t)edit->mesh->element_count, 1);
    if (!parts || !dgfemi_edit_mark_parts(edit, parts)) status = dgfemi_fail_memory(hooks);
    if (!rule->candidate && !all) merger.rule.candidate = parts;
    if (!status && dgfemi_mesh_count_slivers(edit->mesh, &merger.rule) > 0)
        status = dgfemi_edit_run_merger(edit, &merger, &arena, merged);
    dgfemi_arena_free(&arena);
    return status;
}

/* Merges the parts of elements that were split (all: all elements) that are slivers by the ratio or thinner than
   `thickness`, and counts them. */
static dgfem_status dgfemi_edit_merge(dgfemi_edit *edit, dgfem_real ratio, dgfem_real thickness, int all, int *merged) {
    dgfemi_merge_rule rule;
    memset(&rule, 0, sizeof rule);
    rule.ratio = ratio;
    rule.thickness = thickness;
    rule.allows = dgfemi_edit_allows;
    return dgfemi_edit_merge_by(edit, &rule, all, merged);
}
