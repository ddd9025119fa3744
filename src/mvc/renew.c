#pragma once
#include "query.c"
/* A body takes over an edited copy of its mesh. */

/* Conditions of the body in terms of the new mesh. */
typedef struct dgfem_mvci_transfer {
    const dgfem_mvc *body;
    const dgfem_mvci_mesh *mesh;
    char *mark;      /* [numbers of nodes] those a condition has, and what inherits it */
    int *root;       /* [numbers of nodes] the old node that it is a copy of, or DGFEM_NONE */
    int *copy_start; /* [old nodes + 1] into `copies` */
    int *copies;     /* [new nodes] those that are an old node or copies of it */
    int *items;      /* [new nodes or faces] */
} dgfem_mvci_transfer;

static int dgfem_mvci_transfer_reserve(dgfem_mvci_scratch *scratch, dgfem_mvci_transfer *t) {
    const dgfem_mvci_mesh *mesh = t->mesh;
    size_t numbers = (size_t)(mesh->base_count + mesh->birth_count);
    size_t most = (size_t)(mesh->node_count > mesh->face_count ? mesh->node_count : mesh->face_count);
    size_t old_most = (size_t)(t->body->node_count > t->body->face_count ? t->body->node_count : t->body->face_count);
    t->mark = (char *)dgfem_mvci_take(scratch, numbers > old_most ? numbers : old_most, 1);
    t->root = (int *)dgfem_mvci_take(scratch, numbers, sizeof(int));
    t->copy_start = (int *)dgfem_mvci_take(scratch, (size_t)t->body->node_count + 1, sizeof(int));
    t->copies = (int *)dgfem_mvci_take(scratch, (size_t)mesh->node_count, sizeof(int));
    t->items = (int *)dgfem_mvci_take(scratch, most, sizeof(int));
    return t->mark && t->root && t->copy_start && t->copies && t->items;
}

static void dgfem_mvci_trace_copies(dgfem_mvci_transfer *t) {
    const dgfem_mvci_mesh *mesh = t->mesh;
    for (int i = 0; i < mesh->base_count; i++) t->root[i] = i;
    for (int b = 0; b < mesh->birth_count; b++) {
        const int *parent = mesh->births[b].parent;
        t->root[mesh->base_count + b] = parent[1] == DGFEM_NONE ? t->root[parent[0]] : DGFEM_NONE;
    }
    for (int i = 0; i < mesh->node_count; i++) t->items[i] = t->root[mesh->origin[i]];
    dgfem_mvci_list_places(t->items, mesh->node_count, t->body->node_count, t->copy_start, t->copies);
}

/* Fixtures hold what inherits from their nodes. Returns the number of items. */
static int dgfem_mvci_transfer_nodes(dgfem_mvci_transfer *t, const dgfem_mvc_condition *condition) {
    int count = 0;
    memset(t->mark, 0, (size_t)t->mesh->base_count);
    for (int i = 0; i < condition->count; i++) t->mark[condition->items[i]] = 1;
    dgfem_mvci_mesh_inherit(t->mesh, t->mark);
    for (int i = 0; i < t->mesh->node_count; i++)
        if (t->mark[t->mesh->origin[i]]) t->items[count++] = i;
    return count;
}

static int dgfem_mvci_transfer_faces(dgfem_mvci_transfer *t, const dgfem_mvc_condition *condition) {
    int count = 0;
    memset(t->mark, 0, (size_t)t->body->face_count);
    for (int i = 0; i < condition->count; i++) t->mark[condition->items[i]] = 1;
    for (int f = 0; f < t->mesh->face_count; f++) {
        const dgfem_mvci_face *face = &t->mesh->faces[f];
        if (face->owner[1] == DGFEM_NONE && !face->wall && face->from != DGFEM_NONE && t->mark[face->from])
            t->items[count++] = f;
    }
    return count;
}

/* Copies of a node share its force or spring. Returns the number of items; they and their shares are written unless
   NULL. A node may be listed often: there may be more items than nodes. */
static int dgfem_mvci_transfer_copies(const dgfem_mvci_transfer *t, const dgfem_mvc_condition *condition, int *items,
                                      dgfem_real *share) {
    int count = 0;
    for (int k = 0; k < condition->count; k++) {
        int start = t->copy_start[condition->items[k]], end = t->copy_start[condition->items[k] + 1];
        for (int i = start; i < end; i++, count++) {
            if (items) items[count] = t->copies[i];
            if (share) share[count] = condition->share[k] / (dgfem_real)(end - start);
        }
    }
    return count;
}

/* *to is a copy of the condition for the new mesh; 0 when out of memory. */
static int dgfem_mvci_transfer_condition(dgfem_mvci_transfer *t, const dgfem_mvc_condition *from,
                                         dgfem_mvc_condition *to) {
    const dgfem_hooks *hooks = &t->body->hooks;
    *to = *from;
    to->items = NULL, to->share = NULL;
    if (from->share) {
        to->count = dgfem_mvci_transfer_copies(t, from, NULL, NULL);
        to->items = (int *)dgfem_mvci_allocate(hooks, (size_t)to->count, sizeof(int));
        to->share = (dgfem_real *)dgfem_mvci_allocate(hooks, (size_t)to->count, sizeof(dgfem_real));
        if (!to->items || !to->share) return 0;
        (void)dgfem_mvci_transfer_copies(t, from, to->items, to->share);
        return 1;
    }
    to->count = dgfem_mvci_is_face_load(from) ? dgfem_mvci_transfer_faces(t, from) : dgfem_mvci_transfer_nodes(t, from);
    to->items = (int *)dgfem_mvci_duplicate(hooks, t->items, (size_t)to->count, sizeof(int));
    return to->items != NULL;
}

/* next->conditions: those of the body for the new mesh. */
static dgfem_status dgfem_mvci_transfer_conditions(const dgfem_mvc *body, const dgfem_mvci_mesh *mesh,
                                                   dgfem_mvc *next) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    dgfem_mvci_transfer transfer;
    memset(&transfer, 0, sizeof transfer);
    transfer.body = body, transfer.mesh = mesh;
    next->conditions = (dgfem_mvc_condition *)dgfem_mvci_allocate(&body->hooks, (size_t)body->condition_capacity,
                                                                  sizeof *next->conditions);
    next->condition_count = 0;
    int ok = next->conditions && dgfem_mvci_transfer_reserve(&scratch, &transfer);
    if (ok) dgfem_mvci_trace_copies(&transfer);
    for (int c = 0; ok && c < body->condition_count; c++) {
        next->condition_count = c + 1; /* half made ones are freed with the rest */
        ok = dgfem_mvci_transfer_condition(&transfer, &body->conditions[c], &next->conditions[c]);
    }
    dgfem_mvci_scratch_free(&scratch);
    return ok ? DGFEM_OK : dgfem_mvci_fail_memory(&body->hooks);
}

/* Makes an edited, compacted copy of its mesh the body's: state and origin of nodes, faces and elements are those that
   the mesh records since dgfem_mvci_mesh_begin. Elements that have not changed keep their integrals; conditions stay
   where they were; the matrix and its symbolic factorization are left to the next step or solve. On success the mesh is
   the body's, and its history begins anew; on failure nothing has changed and the mesh is still the caller's. */
static dgfem_status dgfem_mvci_body_accept_mesh(dgfem_mvc *body, dgfem_mvci_mesh *mesh) {
    dgfem_mvc next = *body;
    next.mass = next.area = next.modulus = next.volume = NULL;
    next.material = NULL;
    next.tag = NULL;
    next.centre = NULL;
    next.rotation = NULL;
    next.system = NULL;
    next.conditions = NULL;
    next.condition_count = 0;
    dgfem_mvci_adopt_mesh(&next, mesh);
    dgfem_status status = dgfem_mvci_build_topology(&next, NULL, body);
    if (!status) status = dgfem_mvci_transfer_conditions(body, mesh, &next);
    if (status) {
        dgfem_mvci_free_topology(&next);
        dgfem_mvci_free_conditions(&body->hooks, next.conditions, next.condition_count);
        return status;
    }
    dgfem_mvci_free_topology(body);
    dgfem_mvci_free_conditions(&body->hooks, body->conditions, body->condition_count);
    dgfem_mvci_mesh_destroy(body->mesh);
    *body = next;
    body->revision++;
    dgfem_mvci_mesh_begin(body->mesh);
    return DGFEM_OK;
}
