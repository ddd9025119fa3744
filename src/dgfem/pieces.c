#pragma once
#include "query.c"
/* Connected parts of a body. */

/* Sums over the elements of each piece: `centre` is int rho X, `spin` the angular momentum about the origin, until
   dgfemi_piece_end. */
static void dgfemi_piece_add(const dgfem_body *body, int e, dgfem_piece *piece) {
    const dgfemi_element_form *form = &body->forms->elements[e];
    const dgfem_real *mass = dgfemi_form_mass(body->forms, e);
    const dgfem_vec3 *v = body->velocity + body->basis_start[e];
    dgfem_real density = body->material[e].density;
    piece->element_count++;
    piece->volume += body->mesh->elements[e].volume;
    piece->mass += density * mass[0];
    for (int i = 0; i < form->count; i++) {
        dgfem_vec3 x = dgfemi_position_coefficient(body, e, i);
        piece->centre = dgfemi_add_scaled(piece->centre, density * mass[i], x);
        piece->momentum = dgfemi_add_scaled(piece->momentum, density * mass[i], v[i]);
        for (int j = 0; j < form->count; j++)
            piece->spin = dgfemi_add_scaled(piece->spin, density * mass[i * form->count + j], dgfemi_cross(x, v[j]));
    }
}

static void dgfemi_piece_end(dgfem_piece *piece) {
    piece->centre = dgfemi_scale(1 / piece->mass, piece->centre);
    piece->spin = dgfemi_sub(piece->spin, dgfemi_cross(piece->centre, piece->momentum));
}

DGFEM_API dgfem_status dgfem_body_pieces(const dgfem_body *body, int *piece_of, dgfem_piece *pieces, int capacity,
                                         int *count) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!count || capacity < 0)
        return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "pieces: room for %d, or no count", capacity);
    dgfemi_arena arena = dgfemi_arena_make(&body->hooks);
    size_t n = (size_t)body->mesh->element_count;
    int *stack = (int *)dgfemi_arena_allocate(&arena, n, sizeof(int));
    int *own = (int *)dgfemi_arena_allocate(&arena, n, sizeof(int));
    dgfem_status status = stack && own ? DGFEM_OK : dgfemi_fail_memory(&body->hooks);
    if (!status) {
        *count = dgfemi_mesh_pieces(body->mesh, own, stack);
        if (piece_of) memcpy(piece_of, own, n * sizeof(int));
        int room = pieces ? (*count < capacity ? *count : capacity) : 0;
        if (room > 0) memset(pieces, 0, (size_t)room * sizeof *pieces);
        for (size_t e = 0; e < n; e++)
            if (own[e] < room) dgfemi_piece_add(body, (int)e, &pieces[own[e]]);
        for (int k = 0; k < room; k++) dgfemi_piece_end(&pieces[k]);
    }
    dgfemi_arena_free(&arena);
    return status;
}
