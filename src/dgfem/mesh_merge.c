#pragma once
#include "mesh.c"
/* dgfem_mesh_merge_slivers: small elements vanish into a neighbour. */

/* A small element; the entry is stale when the element has gone or grown since. */
typedef struct dgfemi_sliver {
    dgfem_real volume;
    int element;
} dgfemi_sliver;

/* What is small, and what may be merged with what. */
typedef struct dgfemi_merge_rule {
    dgfem_real volume; /* elements smaller than this are slivers, */
    dgfem_real
        ratio; /* and those that this times the largest glued neighbour exceeds, in volume or, cubed, in thickness */
    dgfem_real thickness;  /* elements thinner than this (volume over largest face) are slivers, too */
    const char *candidate; /* [element_count] 1: may be merged into a neighbour; or NULL: all may */
    int (*allows)(const void *user, int a, int b); /* NULL: all pairs; the arguments are tags */
    const void *user;
} dgfemi_merge_rule;

typedef struct dgfemi_merger {
    dgfem_mesh *mesh;
    dgfemi_merge_rule rule;
    int *union_of;       /* [element_count] the element that took this one in, or DGFEM_NONE; may be NULL */
    dgfemi_sliver *heap; /* the smallest first */
    int heap_count;
    int *mark;              /* [element_count] the last `stamp` at which the element was seen as a neighbour */
    dgfem_real *glued_area; /* [element_count] shared with the sliver at work; negative: not a candidate */
    int stamp;
    dgfemi_ints neighbours; /* of the sliver at work */
    dgfemi_ints faces;      /* of the union at work */
    dgfemi_edges edges;
} dgfemi_merger;

/* ---- heap ---- */

/* Equal volumes go by index, so that the result does not depend on the heap. */
static int dgfemi_sliver_less(dgfemi_sliver a, dgfemi_sliver b) {
    return a.volume < b.volume || (!(b.volume < a.volume) && a.element < b.element);
}

/* There is room: each push follows a pop or the counting of small elements. */
static void dgfemi_heap_push(dgfemi_merger *merger, int element) {
    dgfemi_sliver item;
    int i = merger->heap_count++;
    item.volume = merger->mesh->elements[element].volume;
    item.element = element;
    for (; i > 0 && dgfemi_sliver_less(item, merger->heap[(i - 1) / 2]); i = (i - 1) / 2)
        merger->heap[i] = merger->heap[(i - 1) / 2];
    merger->heap[i] = item;
}

static dgfemi_sliver dgfemi_heap_pop(dgfemi_merger *merger) {
    dgfemi_sliver top = merger->heap[0], item = merger->heap[--merger->heap_count];
    int i = 0, child;
    for (child = 1; child < merger->heap_count; child = 2 * i + 1) {
        if (child + 1 < merger->heap_count && dgfemi_sliver_less(merger->heap[child + 1], merger->heap[child])) child++;
        if (!dgfemi_sliver_less(merger->heap[child], item)) break;
        merger->heap[i] = merger->heap[child];
        i = child;
    }
    merger->heap[i] = item;
    return top;
}

/* ---- slivers ---- */

static int dgfemi_mesh_other_side(const dgfem_mesh *mesh, int element, int face) {
    const dgfem_face *f = &mesh->faces[face];
    return f->element[0] == element ? f->element[1] : f->element[0];
}

/* Volume over the area of the largest side: its largest face with all others in the same plane, into which cuts and
   neighbours may have divided it. */
static dgfem_real dgfemi_mesh_thickness(const dgfem_mesh *mesh, int element) {
    const dgfem_real same = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-6);
    const dgfem_element *e = &mesh->elements[element];
    int k, largest = mesh->element_faces[e->face_start];
    dgfem_real area = 0;
    const dgfem_face *side;
    for (k = e->face_start; k < e->face_start + e->face_count; k++)
        if (mesh->faces[mesh->element_faces[k]].area > mesh->faces[largest].area) largest = mesh->element_faces[k];
    side = &mesh->faces[largest];
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        dgfem_real turn = dgfemi_dot(side->normal, face->normal) *
                          (dgfem_real)(dgfemi_mesh_sign(mesh, element, largest) *
                                       dgfemi_mesh_sign(mesh, element, mesh->element_faces[k]));
        dgfem_real height = dgfemi_dot(side->normal, dgfemi_sub(face->centre, side->centre));
        if (turn > 1 - same && dgfemi_abs(height) <= same * e->radius) area += face->area;
    }
    return area > 0 ? e->volume / area : 0;
}

/* Whether the element is a sliver beside one of this volume. */
static int dgfemi_is_sliver_of(const dgfem_mesh *mesh, int element, dgfem_real volume, dgfem_real ratio) {
    dgfem_real thickness = dgfemi_mesh_thickness(mesh, element);
    return mesh->elements[element].volume < ratio * volume ||
           thickness * thickness * thickness < ratio * ratio * ratio * volume;
}

static int dgfemi_is_sliver(const dgfem_mesh *mesh, const dgfemi_merge_rule *rule, int element) {
    const dgfem_element *e = &mesh->elements[element];
    dgfem_real largest = 0;
    int k;
    if (e->face_count == 0 || (rule->candidate && !rule->candidate[element])) return 0;
    if (e->volume < rule->volume) return 1;
    if (rule->thickness > 0 && dgfemi_mesh_thickness(mesh, element) < rule->thickness) return 1;
    if (!(rule->ratio > 0)) return 0;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        int f = mesh->element_faces[k], other = dgfemi_mesh_other_side(mesh, element, f);
        if (other != DGFEM_NONE && !mesh->faces[f].cut) largest = dgfemi_max(largest, mesh->elements[other].volume);
    }
    return dgfemi_is_sliver_of(mesh, element, largest, rule->ratio);
}

/* ---- neighbours ---- */

/* Lists the neighbours of an element with their glued areas. 1 on success, 0 when out of memory. */
static int dgfemi_merger_list_neighbours(dgfemi_merger *merger, int element) {
    const dgfem_mesh *mesh = merger->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k;
    merger->neighbours.count = 0;
    merger->stamp++;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        int f = mesh->element_faces[k], other = dgfemi_mesh_other_side(mesh, element, f);
        if (other == DGFEM_NONE) continue;
        if (merger->mark[other] != merger->stamp) {
            const dgfemi_merge_rule *rule = &merger->rule;
            merger->mark[other] = merger->stamp;
            merger->glued_area[other] = 0;
            if (rule->allows && !rule->allows(rule->user, e->tag, mesh->elements[other].tag))
                merger->glued_area[other] = -1;
            if (!dgfemi_push(&mesh->hooks, &merger->neighbours, other)) return 0;
        }
        if (mesh->faces[f].cut) merger->glued_area[other] = -1; /* a face cannot have one element on both sides */
        if (merger->glued_area[other] >= 0) merger->glued_area[other] += mesh->faces[f].area;
    }
    return 1;
}

/* The neighbour with the largest positive glued area; of equal ones that with the lowest index. */
static int dgfemi_merger_best_neighbour(const dgfemi_merger *merger) {
    dgfem_real largest = 0;
    int i, best = DGFEM_NONE;
    for (i = 0; i < merger->neighbours.count; i++) {
        int n = merger->neighbours.data[i];
        dgfem_real area = merger->glued_area[n];
        if (area > largest || (best != DGFEM_NONE && !(area < largest) && n < best)) best = n, largest = area;
    }
    return best;
}

/* ---- unions ---- */

/* Lists the faces of `element` that it does not share with `other`. 1 on success, 0 when out of memory. */
static int dgfemi_merger_list_faces(dgfemi_merger *merger, int element, int other) {
    const dgfem_mesh *mesh = merger->mesh;
    const dgfem_element *e = &mesh->elements[element];
    int k;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        int f = mesh->element_faces[k];
        if (dgfemi_mesh_other_side(mesh, element, f) == other) continue;
        if (!dgfemi_push(&mesh->hooks, &merger->faces, f)) return 0;
    }
    return 1;
}

/* Adds the edges of the listed faces first <= i < last, which belong to one element. */
static void dgfemi_merger_add_edges(dgfemi_merger *merger, int first, int last, int element) {
    int i;
    for (i = first; i < last; i++) {
        int f = merger->faces.data[i];
        dgfemi_edges_add_face(merger->mesh, &merger->edges, f, dgfemi_mesh_sign(merger->mesh, element, f));
    }
}

/* Lists the faces of the union. *valid: it has any, a positive volume, and every edge that the sliver brings occurs
   once in either direction. The last fails where the two touch along an edge (*) away from the faces that they share:

        +---+---+
        | n |   |        seen along the edge; s and n share a face elsewhere, and their union would have the
        +---*---+        edge twice in either direction
        |   | s |
        +---+---+                                                                                               */
static int dgfemi_merger_try(dgfemi_merger *merger, int sliver, int into, int *valid) {
    const dgfem_mesh *mesh = merger->mesh;
    int i, corners = 0, from_into, from_sliver;
    *valid = 0;
    merger->faces.count = 0;
    if (!dgfemi_merger_list_faces(merger, into, sliver)) return 0;
    from_into = merger->faces.count;
    if (!dgfemi_merger_list_faces(merger, sliver, into)) return 0;
    for (i = 0; i < merger->faces.count; i++) corners += dgfemi_mesh_face_corners(mesh, merger->faces.data[i]);
    if (!dgfemi_edges_reset(&mesh->hooks, &merger->edges, corners)) return 0;
    dgfemi_merger_add_edges(merger, from_into, merger->faces.count, sliver);
    from_sliver = merger->edges.count;
    dgfemi_merger_add_edges(merger, 0, from_into, into);
    if (merger->faces.count == 0) return 1;
    if (!(mesh->elements[sliver].volume + mesh->elements[into].volume > 0)) return 1;
    for (i = 0; i < from_sliver; i++)
        if (merger->edges.data[i].forward != 1 || merger->edges.data[i].backward != 1) return 1;
    *valid = 1;
    return 1;
}

/* Makes the union listed by dgfemi_merger_try of `into`. 1 on success, 0 when out of memory. */
static int dgfemi_merger_apply(dgfemi_merger *merger, int sliver, int into) {
    dgfem_mesh *mesh = merger->mesh;
    dgfem_element *from = &mesh->elements[sliver], *to = &mesh->elements[into];
    int start = dgfemi_mesh_append(&mesh->hooks, &mesh->element_faces, &mesh->element_face_count,
                                   &mesh->element_face_capacity, merger->faces.data, merger->faces.count);
    int k;
    if (start == DGFEM_NONE) return 0;
    for (k = from->face_start; k < from->face_start + from->face_count; k++) {
        dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        if (face->element[0] == into || face->element[1] == into) face->element[0] = face->element[1] = DGFEM_NONE;
        else face->element[face->element[0] == sliver ? 0 : 1] = into;
    }
    from->face_count = 0;
    if (merger->union_of) merger->union_of[sliver] = into;
    to->face_start = start;
    to->face_count = merger->faces.count;
    dgfemi_mesh_measure_element(mesh, into);
    return 1;
}

/* *into: the neighbour that took the sliver in, or DGFEM_NONE. 1 on success, 0 when out of memory. */
static int dgfemi_merger_merge(dgfemi_merger *merger, int sliver, int *into) {
    int valid = 0;
    if (!dgfemi_merger_list_neighbours(merger, sliver)) return 0;
    for (;;) {
        *into = dgfemi_merger_best_neighbour(merger);
        if (*into == DGFEM_NONE) return 1;
        if (!dgfemi_merger_try(merger, sliver, *into, &valid)) return 0;
        if (valid) return dgfemi_merger_apply(merger, sliver, *into);
        merger->glued_area[*into] = -1;
    }
}

/* ---- all slivers ---- */

/* One round over all small elements. 1 on success, 0 when out of memory. */
static int dgfemi_merger_round(dgfemi_merger *merger, int *merged) {
    dgfem_mesh *mesh = merger->mesh;
    int e, into;
    *merged = 0;
    for (e = 0; e < mesh->element_count; e++)
        if (dgfemi_is_sliver(mesh, &merger->rule, e)) dgfemi_heap_push(merger, e);
    while (merger->heap_count > 0) {
        dgfemi_sliver sliver = dgfemi_heap_pop(merger);
        const dgfem_element *element = &mesh->elements[sliver.element];
        if (element->face_count == 0 || element->volume < sliver.volume || element->volume > sliver.volume) continue;
        if (!dgfemi_merger_merge(merger, sliver.element, &into)) return 0;
        if (into == DGFEM_NONE) continue;
        ++*merged;
        if (dgfemi_is_sliver(mesh, &merger->rule, into)) dgfemi_heap_push(merger, into);
    }
    return 1;
}

static int dgfemi_mesh_count_slivers(const dgfem_mesh *mesh, const dgfemi_merge_rule *rule) {
    int e, count = 0;
    for (e = 0; e < mesh->element_count; e++) count += dgfemi_is_sliver(mesh, rule, e);
    return count;
}

/* Rounds until one changes nothing: a merge may give an earlier sliver a neighbour that can take it. Works in place
   and leaves dead items. 1 on success, 0 when out of memory. */
static int dgfemi_merger_run(dgfemi_merger *merger, int *merged, int *left) {
    dgfem_mesh *mesh = merger->mesh;
    dgfemi_arena arena = dgfemi_arena_make(&mesh->hooks);
    size_t n = (size_t)mesh->element_count;
    int ok, round = 0;
    *left = dgfemi_mesh_count_slivers(mesh, &merger->rule);
    merger->heap = (dgfemi_sliver *)dgfemi_arena_allocate(&arena, n, sizeof(dgfemi_sliver));
    merger->mark = (int *)dgfemi_arena_allocate_zero(&arena, n, sizeof(int));
    merger->glued_area = (dgfem_real *)dgfemi_arena_allocate(&arena, n, sizeof(dgfem_real));
    ok = merger->heap && merger->mark && merger->glued_area;
    for (*merged = 0; ok && *left > 0; *merged += round) {
        ok = dgfemi_merger_round(merger, &round);
        *left = dgfemi_mesh_count_slivers(mesh, &merger->rule);
        if (round == 0) break;
    }
    dgfemi_free(&mesh->hooks, merger->neighbours.data);
    dgfemi_free(&mesh->hooks, merger->faces.data);
    dgfemi_edges_free(&mesh->hooks, &merger->edges);
    dgfemi_arena_free(&arena);
    return ok;
}

/* On a copy, so that a failure leaves the mesh as it was. */
static dgfem_status dgfemi_mesh_merge(dgfem_mesh *mesh, const dgfemi_merge_rule *rule, int *merged, int *left) {
    dgfemi_merger merger;
    dgfem_status status;
    memset(&merger, 0, sizeof merger);
    merger.mesh = dgfemi_mesh_duplicate(mesh);
    merger.rule = *rule;
    if (merger.mesh && dgfemi_merger_run(&merger, merged, left)) status = dgfemi_mesh_compact(merger.mesh);
    else status = dgfemi_fail_memory(&mesh->hooks);
    if (!status) dgfemi_mesh_swap(mesh, merger.mesh);
    dgfem_mesh_destroy(merger.mesh);
    return status;
}

DGFEM_API dgfem_status dgfem_mesh_merge_slivers(dgfem_mesh *mesh, dgfem_real volume, int *merged, int *left) {
    dgfem_status status = DGFEM_OK;
    dgfemi_merge_rule rule;
    int went = 0, stayed = 0;
    if (!mesh) return DGFEM_ERROR_ARGUMENT;
    if (!(volume >= 0) || !dgfemi_is_finite(volume))
        return dgfemi_fail(&mesh->hooks, DGFEM_ERROR_ARGUMENT, "merge slivers: volume %g", (double)volume);
    memset(&rule, 0, sizeof rule);
    rule.volume = volume;
    if (dgfemi_mesh_count_slivers(mesh, &rule) > 0) status = dgfemi_mesh_merge(mesh, &rule, &went, &stayed);
    if (status) return status;
    if (merged) *merged = went;
    if (left) *left = stayed;
    return DGFEM_OK;
}
