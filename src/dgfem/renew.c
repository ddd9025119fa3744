#pragma once
#include "edit.c"
#include "pieces.c"
#include "query.c"
/* Editing a body, second half: everything that the edited mesh needs is made beside the body, which then takes it over.

   An element whose region and degree are unchanged keeps its integrals, its centre and its coefficients, bit for bit;
   so does a face between two such elements. Matrix and symbolic factorization are kept where the graph is unchanged.
   New integrals go into the body's own pool, and are given back to it when something fails. */

typedef struct dgfemi_renewal {
    dgfemi_edit *edit;
    dgfem_body *body;                   /* as it is */
    dgfem_body next;                    /* as it will be */
    dgfemi_arena arena;                 /* for the maps */
    int *use;                           /* [fields] elements that have the field */
    int *field;                         /* [elements] */
    char *whole;                        /* [elements] 1: its region is that of its source, */
    char *kept;                         /* and so is its degree */
    int *element_start, *element_child; /* the new elements that have parts of each element of the body */
    int *face_start, *face_child;       /* the new faces that are parts of each face of the body */
    char *chunk_kept;                   /* [face forms of the body] 1: a new form has its integrals */
    char *chunk_new;                    /* [new face forms] 1: has integrals of its own */
    int elements_done;                  /* elements whose integrals are made or taken over */
    int **items;                        /* [conditions] new items; NULL until made */
    int *item_count;
    dgfem_vec3 **values; /* [conditions] new values of held elements, or NULL */
    int solver_kept;
} dgfemi_renewal;

/* ---- maps from the body to the edited mesh ---- */

/* Lists 0 <= i < count by key(i); key DGFEM_NONE is left out. start has `keys` + 1 items. */
static void dgfemi_list_by_key(const int *key, int count, int keys, int *start, int *list) {
    for (int i = 0; i < count; i++)
        if (key[i] != DGFEM_NONE) start[key[i]]++;
    for (int k = 1; k <= keys; k++) start[k] += start[k - 1];
    for (int i = count - 1; i >= 0; i--)
        if (key[i] != DGFEM_NONE) list[--start[key[i]]] = i;
}

static int dgfemi_field_members(const dgfemi_edit *edit, const dgfemi_field *field, const int **members) {
    if (field->source == DGFEM_NONE) {
        *members = edit->members.data + field->member_start;
        return field->member_count;
    }
    *members = &field->source;
    return 1;
}

static int dgfemi_renewal_map_elements(dgfemi_renewal *r) {
    const dgfemi_edit *edit = r->edit;
    const dgfem_mesh *mesh = r->next.mesh;
    const int *members;
    int old = r->body->mesh->element_count, n = mesh->element_count, total = 0;
    r->use = (int *)dgfemi_arena_allocate_zero(&r->arena, (size_t)edit->field_count, sizeof(int));
    r->field = (int *)dgfemi_arena_allocate(&r->arena, (size_t)n, sizeof(int));
    r->whole = (char *)dgfemi_arena_allocate(&r->arena, (size_t)n, 1);
    r->kept = (char *)dgfemi_arena_allocate(&r->arena, (size_t)n, 1);
    r->element_start = (int *)dgfemi_arena_allocate_zero(&r->arena, (size_t)old + 1, sizeof(int));
    if (!r->use || !r->field || !r->whole || !r->kept || !r->element_start) return 0;
    for (int e = 0; e < n; e++) {
        const dgfemi_field *field = &edit->fields[mesh->elements[e].tag];
        int count = dgfemi_field_members(edit, field, &members);
        r->field[e] = mesh->elements[e].tag;
        r->use[r->field[e]]++;
        for (int i = 0; i < count; i++) r->element_start[members[i]]++;
        total += count;
    }
    for (int k = 1; k <= old; k++) r->element_start[k] += r->element_start[k - 1];
    r->element_child = (int *)dgfemi_arena_allocate(&r->arena, (size_t)total, sizeof(int));
    if (!r->element_child) return 0;
    for (int e = n - 1; e >= 0; e--) {
        const dgfemi_field *field = &edit->fields[r->field[e]];
        int count = dgfemi_field_members(edit, field, &members);
        for (int i = 0; i < count; i++) r->element_child[--r->element_start[members[i]]] = e;
        r->whole[e] = field->source != DGFEM_NONE && !field->divided && r->use[r->field[e]] == 1;
        r->kept[e] = r->whole[e] && field->next_degree == field->degree;
    }
    return 1;
}

static int dgfemi_renewal_map_faces(dgfemi_renewal *r) {
    const dgfem_mesh *mesh = r->next.mesh;
    int old = r->body->mesh->face_count;
    int *key = (int *)dgfemi_arena_allocate(&r->arena, (size_t)mesh->face_count, sizeof(int));
    r->face_start = (int *)dgfemi_arena_allocate_zero(&r->arena, (size_t)old + 1, sizeof(int));
    r->face_child = (int *)dgfemi_arena_allocate(&r->arena, (size_t)mesh->face_count, sizeof(int));
    if (!key || !r->face_start || !r->face_child) return 0;
    for (int f = 0; f < mesh->face_count; f++) key[f] = mesh->faces[f].tag;
    dgfemi_list_by_key(key, mesh->face_count, old, r->face_start, r->face_child);
    return 1;
}

/* The caller's tags take the place of the edit's. A part inherits, a union has the tag of its first member. */
static void dgfemi_renewal_restore_tags(dgfemi_renewal *r) {
    dgfem_mesh *mesh = r->next.mesh;
    const dgfem_mesh *old = r->body->mesh;
    for (int e = 0; e < mesh->element_count; e++)
        mesh->elements[e].tag = old->elements[dgfemi_field_element(r->edit, &r->edit->fields[r->field[e]])].tag;
    for (int f = 0; f < mesh->face_count; f++) {
        int tag = mesh->faces[f].tag;
        mesh->faces[f].tag = tag == DGFEM_NONE ? DGFEM_NONE : old->faces[tag].tag;
    }
}

/* ---- state ---- */

static dgfem_status dgfemi_renewal_make_elements(dgfemi_renewal *r) {
    const dgfem_body *body = r->body;
    dgfem_body *next = &r->next;
    int n = next->mesh->element_count;
    if (!dgfemi_body_allocate(next, n)) return DGFEM_ERROR_MEMORY;
    for (int e = 0; e < n; e++) {
        const dgfemi_field *field = &r->edit->fields[r->field[e]];
        int source = dgfemi_field_element(r->edit, field);
        next->degree[e] = field->next_degree;
        next->material[e] = body->material[source];
        next->rotation[e] = body->rotation[source];
        next->origin[e] = r->whole[e] ? body->origin[source] : next->mesh->elements[e].centre;
        next->scale[e] = r->whole[e] ? body->scale[source] : next->mesh->elements[e].radius;
    }
    dgfem_status status = dgfemi_body_count_basis(next);
    if (status) return status;
    return dgfemi_body_allocate_state(next) ? DGFEM_OK : DGFEM_ERROR_MEMORY;
}

/* u_new of one element. The new basis is the first part of the old one or the other way round, so raising adds zeros
   and lowering solves M_new u_new = (first rows of M_old) u_old, with M_new the first rows and columns of M_old. */
static void dgfemi_project_degree(const dgfem_real *mass, int n_old, int n_new, const dgfem_vec3 *old,
                                  dgfem_vec3 *out) {
    dgfem_real m[DGFEM_MAX_BASIS * DGFEM_MAX_BASIS];
    memset(out, 0, (size_t)n_new * sizeof *out);
    if (n_new >= n_old) {
        memcpy(out, old, (size_t)n_old * sizeof *out);
        return;
    }
    for (int i = 0; i < n_new; i++) {
        memcpy(m + i * n_new, mass + i * n_old, (size_t)n_new * sizeof *m);
        for (int j = 0; j < n_old; j++) out[i] = dgfemi_add_scaled(out[i], mass[i * n_old + j], old[j]);
    }
    dgfemi_cholesky_dropping(m, n_new); /* a part may be thinner than its functions can tell */
    dgfemi_cholesky_dense_solve(m, n_new, (dgfem_real *)(void *)out, 3);
}

/* Writes the polynomial `in` of the element's field in the element's new centre, scale and degree. */
static void dgfemi_renewal_move(const dgfemi_renewal *r, int element, const dgfem_vec3 *in, dgfem_vec3 *out) {
    const dgfem_body *next = &r->next;
    const dgfemi_field *field = &r->edit->fields[r->field[element]];
    int n_old = dgfem_monomial_count(field->degree), n_new = dgfem_monomial_count(field->next_degree);
    dgfem_real mass[DGFEM_MAX_BASIS * DGFEM_MAX_BASIS], moments[DGFEM_MAX_MOMENTS];
    dgfem_vec3 moved[DGFEM_MAX_BASIS];
    if (r->kept[element]) {
        memcpy(out, in, (size_t)n_old * sizeof *out);
        return;
    }
    dgfemi_move_polynomial(field->degree, field->origin, field->scale, in, next->origin[element], next->scale[element],
                           moved);
    if (n_new < n_old) {
        dgfemi_element_moments(next->mesh, element, 2 * field->degree, next->origin[element], next->scale[element],
                               moments);
        for (int i = 0; i < n_old; i++)
            for (int j = 0; j < n_old; j++) mass[i * n_old + j] = moments[dgfemi_product_index(i, j)];
    }
    dgfemi_project_degree(mass, n_old, n_new, moved, out);
}

/* The families that elements still belong to, and those that these come from, numbered anew; none at all: no arrays. */
static int dgfemi_renewal_make_families(dgfemi_renewal *r) {
    const dgfemi_ints *parents = &r->edit->families;
    dgfem_body *next = &r->next;
    int n = next->mesh->element_count, count = 0;
    if (parents->count == 0) return 1;
    int *number = (int *)dgfemi_arena_allocate_zero(&r->arena, (size_t)parents->count, sizeof(int));
    if (!number) return 0;
    for (int e = 0; e < n; e++)
        for (int k = r->edit->fields[r->field[e]].family; k != DGFEM_NONE && number[k] == 0; k = parents->data[k])
            number[k] = ++count;
    if (count == 0) return 1;
    next->family = (int *)dgfemi_allocate(&r->body->hooks, (size_t)n, sizeof(int));
    next->family_parent = (int *)dgfemi_allocate(&r->body->hooks, (size_t)count, sizeof(int));
    if (!next->family || !next->family_parent) return 0;
    next->family_count = count;
    for (int e = 0; e < n; e++) {
        int k = r->edit->fields[r->field[e]].family;
        next->family[e] = k == DGFEM_NONE ? DGFEM_NONE : number[k] - 1;
    }
    for (int k = 0; k < parents->count; k++)
        if (number[k] > 0)
            next->family_parent[number[k] - 1] =
                parents->data[k] == DGFEM_NONE ? DGFEM_NONE : number[parents->data[k]] - 1;
    return 1;
}

/* The change of the velocity only tells where the next step looks first: a union takes that of its first member. */
static void dgfemi_renewal_move_change(dgfemi_renewal *r, int element) {
    const dgfem_body *body = r->body;
    const dgfemi_field *field = &r->edit->fields[r->field[element]];
    int source = dgfemi_field_element(r->edit, field);
    const dgfem_vec3 *change = body->change + body->basis_start[source];
    dgfem_vec3 moved[DGFEM_MAX_BASIS];
    if (field->source == DGFEM_NONE) {
        dgfemi_move_polynomial(field->degree, body->origin[source], body->scale[source], change, field->origin,
                               field->scale, moved);
        change = moved;
    }
    dgfemi_renewal_move(r, element, change, r->next.change + r->next.basis_start[element]);
}

static void dgfemi_renewal_move_state(dgfemi_renewal *r) {
    const dgfemi_edit *edit = r->edit;
    dgfem_body *next = &r->next;
    for (int e = 0; e < next->mesh->element_count; e++) {
        const dgfemi_field *field = &edit->fields[r->field[e]];
        dgfemi_renewal_move(r, e, dgfemi_field_displacement(edit, field), next->displacement + next->basis_start[e]);
        dgfemi_renewal_move(r, e, dgfemi_field_velocity(edit, field), next->velocity + next->basis_start[e]);
        dgfemi_renewal_move_change(r, e);
    }
}

/* ---- integrals ---- */

static int dgfemi_renewal_element_forms(dgfemi_renewal *r) {
    dgfem_forms *forms = r->next.forms;
    for (; r->elements_done < r->next.mesh->element_count; r->elements_done++) {
        int e = r->elements_done;
        if (r->kept[e]) forms->elements[e] = r->body->forms->elements[r->edit->fields[r->field[e]].source];
        else if (!dgfemi_forms_set_element(&r->next, forms, e)) return 0;
    }
    return 1;
}

/* The face form of the body that a new one between the same sides may take over, if it has one; else DGFEM_NONE. */
static int dgfemi_renewal_find_form(const dgfemi_renewal *r, const int *form_of_face, int tag, const dgfem_face *face) {
    if (tag == DGFEM_NONE || form_of_face[tag] == DGFEM_NONE || r->face_start[tag + 1] - r->face_start[tag] != 1)
        return DGFEM_NONE;
    if (!r->kept[face->element[0]] || (face->element[1] != DGFEM_NONE && !r->kept[face->element[1]])) return DGFEM_NONE;
    const dgfemi_face_form *form = &r->body->forms->faces[form_of_face[tag]];
    int a = r->edit->fields[r->field[face->element[0]]].source;
    return form->element[0] == a ? form_of_face[tag] : DGFEM_NONE; /* sides may have been exchanged */
}

/* Carries the prescribed polynomial of a held face over to a part of it. */
static void dgfemi_renewal_move_ghost(const dgfemi_renewal *r, const dgfemi_face_form *from, dgfemi_face_form *to) {
    dgfem_forms *forms = r->next.forms;
    const dgfem_face *old = &r->body->mesh->faces[from->face], *face = &r->next.mesh->faces[to->face];
    dgfem_vec3 in[DGFEM_MAX_BASIS], out[DGFEM_MAX_BASIS];
    int n = from->count[1], kept = n < to->count[1] ? n : to->count[1], degree = n == 4 ? 1 : n == 10 ? 2 : 3;
    memcpy(in, dgfemi_form_ghost(forms, from), (size_t)n * sizeof *in); /* by the pool where it is now */
    dgfemi_move_polynomial(degree, old->centre, dgfemi_face_radius(r->body->mesh, old), in, face->centre,
                           dgfemi_face_radius(r->next.mesh, face), out);
    memcpy(dgfemi_form_ghost(forms, to), out, (size_t)kept * sizeof *out);
}

/* Appends the form of a new face: the body's form `from`, if it can be taken over, else new integrals. `held` is the
   body's form of the held face that it is a part of, or DGFEM_NONE. 0 when out of memory. */
static int dgfemi_renewal_add_form(dgfemi_renewal *r, int face, int from, int held) {
    const dgfem_forms *old = r->body->forms;
    dgfem_forms *forms = r->next.forms;
    const dgfem_face *f = &r->next.mesh->faces[face];
    dgfemi_face_form *form = &forms->faces[forms->face_count];
    if (from != DGFEM_NONE) {
        *form = old->faces[from];
        form->face = face;
        form->element[0] = f->element[0], form->element[1] = f->element[1];
        r->chunk_kept[from] = 1;
        r->chunk_new[forms->face_count++] = 0;
        return 1;
    }
    int condition = held == DGFEM_NONE ? DGFEM_NONE : old->faces[held].condition;
    int normal_only = held == DGFEM_NONE ? 0 : old->faces[held].normal_only;
    DGFEM_ASSERT(forms->face_count < forms->face_capacity);
    if (dgfemi_forms_add_face(&r->next, forms, face, condition, normal_only) == DGFEM_NONE) return 0;
    r->chunk_new[forms->face_count - 1] = 1;
    if (held != DGFEM_NONE) dgfemi_renewal_move_ghost(r, &old->faces[held], &forms->faces[forms->face_count - 1]);
    return 1;
}

static int dgfemi_renewal_face_forms(dgfemi_renewal *r) {
    const dgfem_forms *old = r->body->forms;
    const dgfem_mesh *mesh = r->next.mesh;
    int *form_of_face = (int *)dgfemi_arena_allocate(&r->arena, (size_t)r->body->mesh->face_count, sizeof(int));
    if (!form_of_face) return 0;
    for (int f = 0; f < r->body->mesh->face_count; f++) form_of_face[f] = DGFEM_NONE;
    for (int k = 0; k < old->face_count; k++) form_of_face[old->faces[k].face] = k;
    for (int f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        if (face->element[1] == DGFEM_NONE || face->cut) continue;
        if (!dgfemi_renewal_add_form(r, f, dgfemi_renewal_find_form(r, form_of_face, face->tag, face), DGFEM_NONE))
            return 0;
    }
    for (int k = 0; k < old->face_count; k++) {
        int tag = old->faces[k].face;
        if (old->faces[k].condition == DGFEM_NONE) continue;
        for (int i = r->face_start[tag]; i < r->face_start[tag + 1]; i++) {
            int f = r->face_child[i];
            if (!dgfemi_renewal_add_form(r, f, dgfemi_renewal_find_form(r, form_of_face, tag, &mesh->faces[f]), k))
                return 0;
        }
    }
    return 1;
}

/* The new forms share the body's pool from here until they are accepted or dropped. */
static int dgfemi_renewal_make_forms(dgfemi_renewal *r) {
    const dgfem_hooks *hooks = &r->body->hooks;
    const dgfem_forms *old = r->body->forms;
    const dgfem_mesh *mesh = r->next.mesh;
    size_t faces = 0;
    for (int f = 0; f < mesh->face_count; f++) faces += mesh->faces[f].element[1] != DGFEM_NONE && !mesh->faces[f].cut;
    for (int k = 0; k < old->face_count; k++)
        if (old->faces[k].condition != DGFEM_NONE)
            faces += (size_t)(r->face_start[old->faces[k].face + 1] - r->face_start[old->faces[k].face]);
    r->chunk_kept = (char *)dgfemi_arena_allocate_zero(&r->arena, (size_t)old->face_count, 1);
    r->chunk_new = (char *)dgfemi_arena_allocate(&r->arena, faces, 1);
    dgfem_forms *forms = (dgfem_forms *)dgfemi_duplicate(hooks, old, 1, sizeof *forms);
    if (!r->chunk_kept || !r->chunk_new || !forms) {
        dgfemi_free(hooks, forms);
        return 0;
    }
    r->next.forms = forms;
    forms->elements =
        (dgfemi_element_form *)dgfemi_allocate(hooks, (size_t)mesh->element_count, sizeof *forms->elements);
    forms->faces = (dgfemi_face_form *)dgfemi_allocate(hooks, faces, sizeof *forms->faces);
    forms->face_count = 0, forms->face_capacity = (int)faces;
    return forms->elements && forms->faces && dgfemi_renewal_element_forms(r) && dgfemi_renewal_face_forms(r);
}

/* Gives the integrals made for the edit back to the pool. */
static void dgfemi_renewal_give_new(dgfemi_renewal *r) {
    const dgfem_hooks *hooks = &r->body->hooks;
    dgfem_forms *forms = r->next.forms;
    for (int e = 0; e < r->elements_done; e++) {
        const dgfemi_element_form *form = &forms->elements[e];
        if (!r->kept[e]) dgfemi_forms_give(forms, hooks, dgfemi_element_form_size(form->count), form->data);
    }
    for (int k = 0; k < forms->face_count; k++) {
        const dgfemi_face_form *form = &forms->faces[k];
        if (r->chunk_new[k]) dgfemi_forms_give(forms, hooks, dgfemi_face_form_size(form), form->data);
    }
}

/* Gives those of the body that the edited one has no use for back to the pool. */
static void dgfemi_renewal_give_old(dgfemi_renewal *r) {
    const dgfem_hooks *hooks = &r->body->hooks;
    dgfem_forms *forms = r->next.forms;
    const dgfem_forms *old = r->body->forms;
    for (int e = 0; e < r->body->mesh->element_count; e++) {
        int first = r->element_start[e], count = r->element_start[e + 1] - first;
        if (count == 1 && r->kept[r->element_child[first]]) continue;
        dgfemi_forms_give(forms, hooks, dgfemi_element_form_size(old->elements[e].count), old->elements[e].data);
    }
    for (int k = 0; k < old->face_count; k++)
        if (!r->chunk_kept[k])
            dgfemi_forms_give(forms, hooks, dgfemi_face_form_size(&old->faces[k]), old->faces[k].data);
}

/* ---- conditions ---- */

static int dgfemi_condition_is_on_faces(dgfem_condition_kind kind) {
    return kind == DGFEM_CONDITION_FIX_FACES || kind == DGFEM_CONDITION_FIX_NORMAL ||
           kind == DGFEM_CONDITION_TRACTION || kind == DGFEM_CONDITION_PRESSURE;
}

/* The part of an element that contains a point; where round-off lets none do so, the one with the nearest centre. */
static int dgfemi_renewal_find_part(const dgfemi_renewal *r, int element, dgfem_vec3 x) {
    const dgfem_mesh *mesh = r->next.mesh;
    int best = r->element_child[r->element_start[element]];
    if (r->element_start[element + 1] - r->element_start[element] == 1) return best;
    for (int i = r->element_start[element]; i < r->element_start[element + 1]; i++) {
        int e = r->element_child[i];
        if (dgfemi_element_contains(mesh, e, x)) return e;
        if (dgfemi_distance(mesh->elements[e].centre, x) < dgfemi_distance(mesh->elements[best].centre, x)) best = e;
    }
    return best;
}

/* The new items of condition c: all parts of its faces or elements; of a point, the part that contains it. */
static int dgfemi_renewal_make_items(dgfemi_renewal *r, int c, int *mark) {
    const dgfem_condition *condition = &r->body->conditions[c];
    int faces = dgfemi_condition_is_on_faces(condition->kind), count = 0;
    const int *start = faces ? r->face_start : r->element_start, *child = faces ? r->face_child : r->element_child;
    int point = condition->kind == DGFEM_CONDITION_PIN || condition->kind == DGFEM_CONDITION_FORCE;
    size_t room = 0;
    for (int i = 0; i < condition->count; i++)
        room += (size_t)(start[condition->items[i] + 1] - start[condition->items[i]]);
    int *items = (int *)dgfemi_allocate(&r->body->hooks, point ? 1 : room, sizeof(int));
    r->items[c] = items;
    if (!items) return 0;
    if (point) items[count++] = dgfemi_renewal_find_part(r, condition->items[0], condition->point);
    for (int i = 0; !point && i < condition->count; i++)
        for (int k = start[condition->items[i]]; k < start[condition->items[i] + 1]; k++) {
            int *first = &mark[child[k]]; /* the item that brought it in; one of another is the same union */
            if (!faces && *first != DGFEM_NONE && *first != condition->items[i]) continue;
            if (!faces) *first = condition->items[i];
            items[count++] = child[k];
        }
    for (int i = 0; !faces && i < count; i++) mark[items[i]] = DGFEM_NONE;
    r->item_count[c] = count;
    return 1;
}

/* The new values of a condition that holds elements. */
static int dgfemi_renewal_make_values(dgfemi_renewal *r, int c) {
    const dgfem_condition *condition = &r->body->conditions[c];
    const dgfem_vec3 *from = condition->values;
    size_t count = 0;
    for (int i = 0; i < r->item_count[c]; i++) count += (size_t)dgfemi_element_basis(&r->next, r->items[c][i]);
    dgfem_vec3 *to = (dgfem_vec3 *)dgfemi_allocate(&r->body->hooks, count, sizeof *to);
    r->values[c] = to;
    if (!to) return 0;
    for (int i = 0; i < condition->count; i++) {
        int element = condition->items[i];
        for (int k = r->element_start[element]; k < r->element_start[element + 1]; k++) {
            dgfemi_renewal_move(r, r->element_child[k], from, to);
            to += dgfemi_element_basis(&r->next, r->element_child[k]);
        }
        from += dgfemi_element_basis(r->body, element);
    }
    return 1;
}

static int dgfemi_renewal_make_conditions(dgfemi_renewal *r) {
    size_t count = (size_t)r->body->condition_count;
    int *mark = (int *)dgfemi_arena_allocate_zero(&r->arena, (size_t)r->next.mesh->element_count, sizeof(int));
    r->item_count = (int *)dgfemi_arena_allocate_zero(&r->arena, count, sizeof(int));
    r->values = (dgfem_vec3 **)dgfemi_arena_allocate_zero(&r->arena, count, sizeof *r->values);
    r->items = (int **)dgfemi_arena_allocate_zero(&r->arena, count, sizeof *r->items);
    if (!mark || !r->item_count || !r->values || !r->items) {
        r->items = NULL;
        return 0;
    }
    for (int e = 0; e < r->next.mesh->element_count; e++) mark[e] = DGFEM_NONE;
    for (int c = 0; c < r->body->condition_count; c++) {
        if (!dgfemi_renewal_make_items(r, c, mark)) return 0;
        if (r->body->conditions[c].kind == DGFEM_CONDITION_FIX_ELEMENTS && !dgfemi_renewal_make_values(r, c)) return 0;
    }
    return 1;
}

/* ---- solver ---- */

static int dgfemi_same_pattern(const dgfem_matrix *a, const dgfem_matrix *b) {
    size_t n = (size_t)a->block_count;
    if (a->block_count != b->block_count || a->row_start[n] != b->row_start[n]) return 0;
    return memcmp(a->offset, b->offset, (n + 1) * sizeof(int)) == 0 &&
           memcmp(a->row_start, b->row_start, (n + 1) * sizeof(int)) == 0 &&
           memcmp(a->column, b->column, (size_t)a->row_start[n] * sizeof(int)) == 0;
}

static dgfem_status dgfemi_renewal_make_solver(dgfemi_renewal *r) {
    dgfem_status status = dgfemi_body_create_matrix(&r->next);
    if (status) return status;
    r->solver_kept = dgfemi_same_pattern(r->body->matrix, r->next.matrix);
    if (!r->solver_kept) return dgfemi_body_create_factor(&r->next, r->body->step_solver);
    dgfem_matrix_destroy(r->next.matrix);
    r->next.matrix = r->body->matrix, r->next.cholesky = r->body->cholesky, r->next.work = r->body->work;
    r->next.step_solver = r->body->step_solver;
    return DGFEM_OK;
}

/* ---- all of it ---- */

/* Frees the members that a renewal makes; those of `body` that it has replaced, or those of `next` that came to
   nothing. */
static void dgfemi_renewal_free_body(dgfemi_renewal *r, dgfem_body *body) {
    dgfem_hooks hooks = r->body->hooks;
    dgfemi_free(&hooks, body->degree);
    dgfemi_free(&hooks, body->material);
    dgfemi_free(&hooks, body->origin);
    dgfemi_free(&hooks, body->scale);
    dgfemi_free(&hooks, body->rotation);
    dgfemi_free(&hooks, body->basis_start);
    dgfemi_free(&hooks, body->displacement);
    dgfemi_free(&hooks, body->velocity);
    dgfemi_free(&hooks, body->change);
    dgfemi_free(&hooks, body->force);
    dgfemi_free(&hooks, body->family);
    dgfemi_free(&hooks, body->family_parent);
    dgfemi_contacts_destroy(body->contacts);
    if (r->solver_kept) return;
    dgfemi_free(&hooks, body->work);
    dgfem_matrix_destroy(body->matrix);
    dgfem_cholesky_destroy(body->cholesky);
    dgfemi_step_solver_destroy(body->step_solver, &hooks);
}

/* Drops the renewal. The body is as before, but for a pool that may have grown. */
static void dgfemi_renewal_abort(dgfemi_renewal *r) {
    const dgfem_hooks *hooks = &r->body->hooks;
    dgfem_forms *forms = r->next.forms, *old = r->body->forms;
    if (forms) {
        dgfemi_renewal_give_new(r);
        dgfemi_free(hooks, forms->elements);
        dgfemi_free(hooks, forms->faces);
        forms->elements = old->elements, forms->faces = old->faces;
        forms->face_count = old->face_count, forms->face_capacity = old->face_capacity;
        *old = *forms;
        dgfemi_free(hooks, forms);
    }
    for (int c = 0; r->items && c < r->body->condition_count; c++) {
        dgfemi_free(hooks, r->items[c]);
        dgfemi_free(hooks, r->values[c]);
    }
    dgfemi_renewal_free_body(r, &r->next);
    dgfemi_arena_free(&r->arena);
}

/* Makes everything that the edited mesh needs; the edit's mesh is compacted. On failure all is dropped. */
static dgfem_status dgfemi_renewal_make(dgfemi_renewal *r, dgfemi_edit *edit, dgfem_body *body) {
    dgfem_body *next = &r->next;
    dgfem_status status = dgfemi_mesh_compact(edit->mesh);
    if (status) return status;
    memset(r, 0, sizeof *r);
    r->edit = edit, r->body = body;
    r->arena = dgfemi_arena_make(&body->hooks);
    *next = *body;
    next->mesh = edit->mesh;
    next->revision++; /* what is embedded is embedded in the new revision */
    next->degree = next->basis_start = NULL;
    next->material = NULL, next->origin = NULL, next->scale = NULL, next->rotation = NULL;
    next->displacement = next->velocity = next->change = next->force = NULL;
    next->family = next->family_parent = NULL, next->family_count = 0;
    next->forms = NULL, next->contacts = NULL, next->matrix = NULL, next->cholesky = NULL, next->work = NULL;
    next->step_solver = NULL;
    status = DGFEM_ERROR_MEMORY;
    if (dgfemi_renewal_map_elements(r) && dgfemi_renewal_map_faces(r)) status = dgfemi_renewal_make_elements(r);
    if (!status && !(dgfemi_renewal_make_families(r) && dgfemi_renewal_make_forms(r))) status = DGFEM_ERROR_MEMORY;
    if (!status) {
        dgfemi_renewal_move_state(r);
        status = dgfemi_renewal_make_conditions(r) ? dgfemi_renewal_make_solver(r) : DGFEM_ERROR_MEMORY;
    }
    int silent = status == DGFEM_ERROR_MEMORY;
    if (!status) dgfemi_renewal_restore_tags(r);
    if (!status && body->contacts) status = dgfemi_contacts_renew(body->contacts, next, &next->contacts);
    if (!status) return DGFEM_OK;
    dgfemi_renewal_abort(r);
    return silent ? dgfemi_fail_memory(&body->hooks) : status;
}

/* Swaps: the body is the edited one. Cannot fail. */
static void dgfemi_renewal_accept(dgfemi_renewal *r) {
    const dgfem_hooks *hooks = &r->body->hooks;
    dgfem_body *body = r->body, last = *body;
    dgfemi_renewal_give_old(r);
    for (int c = 0; c < body->condition_count; c++) {
        dgfem_condition *condition = &body->conditions[c];
        dgfemi_free(hooks, condition->items);
        condition->items = r->items[c];
        condition->count = r->item_count[c];
        if (!r->values[c]) continue;
        dgfemi_free(hooks, condition->values);
        condition->values = r->values[c];
    }
    *body = r->next;
    if (r->solver_kept && body->step_solver) { /* elements may have changed places */
        body->step_solver->is_factored = 0;
        body->step_solver->past_count = 0;
    }
    body->desc.mesh = body->mesh;
    r->edit->mesh = last.mesh; /* which is freed with the edit */
    dgfemi_update_force(body);
    dgfemi_free(hooks, last.forms->elements);
    dgfemi_free(hooks, last.forms->faces);
    dgfemi_free(hooks, last.forms);
    dgfemi_renewal_free_body(r, &last);
    dgfemi_arena_free(&r->arena);
}

/* Ends an edit that came so far: the body is the edited one, or as it was. */
static dgfem_status dgfemi_edit_finish(dgfemi_edit *edit, dgfem_body *body) {
    dgfemi_renewal renewal;
    dgfem_status status = dgfemi_renewal_make(&renewal, edit, body);
    if (!status) dgfemi_renewal_accept(&renewal);
    return status;
}

/* ---- pieces that come off ---- */

/* Of what was one piece before the edit the largest stays; the others are new pieces. */
typedef struct dgfemi_separation {
    int *piece_of; /* [elements] of the edited body */
    int *is_new;   /* [pieces] */
    int *list;     /* [elements] room for the elements of one piece */
    int count;     /* pieces */
} dgfemi_separation;

/* Before the renewal is accepted; memory from the arena. 1 on success. */
static int dgfemi_separation_find(const dgfemi_renewal *r, dgfemi_arena *arena, dgfemi_separation *s) {
    const dgfem_mesh *old = r->body->mesh, *mesh = r->next.mesh;
    size_t most = (size_t)(old->element_count > mesh->element_count ? old->element_count : mesh->element_count);
    int *before = (int *)dgfemi_arena_allocate(arena, (size_t)old->element_count, sizeof(int));
    s->piece_of = (int *)dgfemi_arena_allocate(arena, (size_t)mesh->element_count, sizeof(int));
    s->list = (int *)dgfemi_arena_allocate(arena, most, sizeof(int));
    if (!before || !s->piece_of || !s->list) return 0;
    int old_count = dgfemi_mesh_pieces(old, before, s->list);
    s->count = dgfemi_mesh_pieces(mesh, s->piece_of, s->list);
    int *parent = (int *)dgfemi_arena_allocate(arena, (size_t)s->count, sizeof(int));
    int *largest = (int *)dgfemi_arena_allocate(arena, (size_t)old_count, sizeof(int));
    dgfem_real *volume = (dgfem_real *)dgfemi_arena_allocate_zero(arena, (size_t)s->count, sizeof *volume);
    s->is_new = (int *)dgfemi_arena_allocate(arena, (size_t)s->count, sizeof(int));
    if (!parent || !largest || !volume || !s->is_new) return 0;
    for (int k = 0; k < old_count; k++) largest[k] = DGFEM_NONE;
    for (int e = 0; e < mesh->element_count; e++) {
        volume[s->piece_of[e]] += mesh->elements[e].volume;
        parent[s->piece_of[e]] = before[dgfemi_field_element(r->edit, &r->edit->fields[r->field[e]])];
    }
    for (int k = 0; k < s->count; k++) {
        int *best = &largest[parent[k]];
        s->is_new[k] = 1;
        if (*best == DGFEM_NONE || volume[k] > volume[*best]) *best = k;
    }
    for (int k = 0; k < old_count; k++)
        if (largest[k] != DGFEM_NONE) s->is_new[largest[k]] = 0;
    return 1;
}

/* After the renewal was accepted: one call for each new piece. */
static void dgfemi_separation_tell(const dgfemi_separation *s, const dgfem_body *body, dgfem_new_piece_fn fn,
                                   void *user) {
    for (int k = 0; fn && k < s->count; k++) {
        int count = 0;
        if (!s->is_new[k]) continue;
        for (int e = 0; e < body->mesh->element_count; e++)
            if (s->piece_of[e] == k) s->list[count++] = e;
        fn(user, body, k, s->list, count);
    }
}
