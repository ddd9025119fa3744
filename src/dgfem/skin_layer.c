#pragma once
#include "query.c"
#include "skin_split.c"
/* What a blade meets of a body, in layers: elements that the blade's plane crosses and that hang together through glued
   faces. Flaps and pieces may overlap in the world, and several layers lie at one place; each has cross-sections of its
   own. */

/* Whether the plane meets the image of the element's sphere. */
static int dgfemi_skin_meets(const dgfem_body *body, const dgfemi_blade *blade, int element) {
    const dgfem_element *e = &body->mesh->elements[element];
    dgfem_mat3 f = dgfemi_gradient(body, element, e->centre);
    dgfem_vec3 centre = dgfemi_add(e->centre, dgfemi_evaluate(body, body->displacement, element, e->centre));
    dgfem_vec3 normal = dgfemi_vec3(dgfemi_dot(dgfemi_column(&f, 0), blade->normal),
                                    dgfemi_dot(dgfemi_column(&f, 1), blade->normal),
                                    dgfemi_dot(dgfemi_column(&f, 2), blade->normal));
    return dgfemi_abs(dgfemi_blade_distance(blade, centre)) <= e->radius * dgfemi_norm(normal);
}

/* Gives all elements that hang together with `first` and wait for it (their layer is `waiting`) its layer. */
static void dgfemi_skin_flood_layer(dgfemi_skin_cutter *c, int first, int waiting, int *stack) {
    const dgfem_mesh *mesh = c->before->mesh;
    int count = 0;
    stack[count++] = first, c->layer[first] = c->layer_count;
    while (count > 0) {
        int element = stack[--count];
        const dgfem_element *e = &mesh->elements[element];
        for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
            const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
            int other = face->element[face->element[0] == element];
            if (other == DGFEM_NONE || face->cut || c->layer[other] != waiting) continue;
            c->layer[other] = c->layer_count;
            stack[count++] = other;
        }
    }
    c->layer_count++;
}

/* Fills c->layer. 1 on success. */
static int dgfemi_skin_find_layers(dgfemi_skin_cutter *c) {
    int count = c->before->mesh->element_count, waiting = count;
    int *stack = (int *)dgfemi_allocate(c->hooks, (size_t)count, sizeof(int));
    c->layer = (int *)dgfemi_allocate(c->hooks, (size_t)count, sizeof(int));
    for (int e = 0; c->layer && e < count; e++)
        c->layer[e] = dgfemi_skin_meets(c->before, c->blade, e) ? waiting : DGFEM_NONE;
    for (int e = 0; stack && c->layer && e < count; e++)
        if (c->layer[e] == waiting) dgfemi_skin_flood_layer(c, e, waiting, stack);
    dgfemi_free(c->hooks, stack);
    return stack && c->layer;
}

/* Inverts an element's map by Newton's method: the material point that it takes to x. 0 where that does not
   converge. */
static int dgfemi_skin_invert(const dgfem_body *body, int element, dgfem_vec3 x, dgfem_vec3 *rest) {
    const dgfem_element *e = &body->mesh->elements[element];
    dgfem_vec3 r;
    *rest = e->centre;
    for (int step = 0; step < (body->degree[element] == 1 ? 1 : 12); step++) {
        dgfem_mat3 f = dgfemi_gradient(body, element, *rest);
        dgfem_vec3 c0 = dgfemi_column(&f, 0), c1 = dgfemi_column(&f, 1), c2 = dgfemi_column(&f, 2);
        dgfem_real determinant = dgfemi_determinant(&f);
        r = dgfemi_sub(x, dgfemi_add(*rest, dgfemi_evaluate(body, body->displacement, element, *rest)));
        if (!(dgfemi_abs(determinant) > 0)) return 0;
        *rest = dgfemi_add(*rest, dgfemi_scale(1 / determinant, /* Cramer's rule */
                                               dgfemi_vec3(dgfemi_dot(r, dgfemi_cross(c1, c2)),
                                                           dgfemi_dot(c0, dgfemi_cross(r, c2)),
                                                           dgfemi_dot(c0, dgfemi_cross(c1, r)))));
    }
    r = dgfemi_sub(x, dgfemi_add(*rest, dgfemi_evaluate(body, body->displacement, element, *rest)));
    return dgfemi_norm(r) <= DGFEM_R(1e-3) * (e->radius + dgfemi_distance(*rest, e->centre));
}

/* A corner of the polygon that lies farther than this outside every element of a layer, in radii, is left out: there
   the slit does not close, and the polygon may be as large as it likes. */
#define DGFEM_CORNER_REACH DGFEM_R(0.25)

/* The material point of a layer (DGFEM_NONE: of all layers) that is now at x, or which an element's map would take
   there whose outside it is nearest to; and that element. Returns how far outside it lies, in radii of the element,
   where that is at most DGFEM_CORNER_REACH, else something larger. */
static dgfem_real dgfemi_skin_rest_of(const dgfemi_skin_cutter *c, dgfem_vec3 x, int layer, dgfem_vec3 *out,
                                      int *element) {
    const dgfem_mesh *mesh = c->before->mesh;
    dgfem_real smallest = (dgfem_real)HUGE_VAL;
    *out = x, *element = DGFEM_NONE;
    for (int e = 0; e < mesh->element_count; e++) {
        dgfem_vec3 rest;
        dgfem_real distance;
        if (layer == DGFEM_NONE ? c->layer[e] == DGFEM_NONE : c->layer[e] != layer) continue;
        if (!dgfemi_skin_invert(c->before, e, x, &rest)) continue;
        distance = dgfemi_distance(rest, mesh->elements[e].centre) / mesh->elements[e].radius;
        if (distance <= 1 + DGFEM_CORNER_REACH)
            distance = dgfemi_locate_in(mesh, e, rest).distance / mesh->elements[e].radius;
        if (distance < smallest) smallest = distance, *out = rest, *element = e;
    }
    return smallest;
}

/* Gives the points of the cross-section, which segments join to chains, the layer that most of a chain's points are in:
   here and there a point is carried by an element across an earlier cut. 1 on success. */
static int dgfemi_skin_find_cap_layers(dgfemi_skin_cutter *c) {
    int *root = (int *)dgfemi_allocate(c->hooks, (size_t)c->cap_count, sizeof(int));
    int *votes = (int *)dgfemi_allocate_zero(c->hooks, (size_t)c->cap_count, sizeof(int));
    int ok = root && votes;
    for (int i = 0; ok && i < c->cap_count; i++) root[i] = i, c->caps[i].layer = DGFEM_NONE;
    for (int i = 0; ok && i < c->segments.count; i++)
        root[dgfemi_corner_root(root, c->segments.data[i].from)] = dgfemi_corner_root(root, c->segments.data[i].to);
    for (int i = 0; ok && i < c->cap_count; i++) { /* the majority's vote, by Boyer and Moore */
        int r = dgfemi_corner_root(root, i), vote = c->layer[c->caps[i].element];
        if (vote == DGFEM_NONE) continue;
        if (votes[r] == 0) c->caps[r].layer = vote;
        votes[r] += c->caps[r].layer == vote ? 1 : -1;
    }
    for (int i = 0; ok && i < c->cap_count; i++) c->caps[i].layer = c->caps[dgfemi_corner_root(root, i)].layer;
    dgfemi_free(c->hooks, root);
    dgfemi_free(c->hooks, votes);
    return ok;
}
