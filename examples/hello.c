/* A beam, clamped at one end, bends under its own weight and comes to rest. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include <stdio.h>

static void print_line(void *user, dgfem_log_level level, const char *text) {
    (void)user, (void)level;
    fprintf(stderr, "%s\n", text);
}

int main(void) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    grid.upper.x = 4; /* 4 x 1 x 1 m */
    grid.cells[0] = 8, grid.cells[1] = 2, grid.cells[2] = 2;
    dgfem_mesh *mesh;
    if (dgfem_mesh_create_grid(&grid, &mesh)) return 1;

    dgfem_body_desc desc = dgfem_default_body_desc(); /* gravity is (0, 0, -9.81) m/s^2 */
    desc.mesh = mesh;
    desc.material.young = DGFEM_R(2.5e6); /* Pa */
    desc.damping_mass = 2;                /* 1/s */
    desc.hooks.log = print_line;
    dgfem_body *body;
    if (dgfem_body_create(&desc, &body)) return 1;

    dgfem_plane wall = {{1, 0, 0}, 0}, end = {{1, 0, 0}, 4};
    int held[4], tip[4];
    dgfem_mesh_faces_on_plane(body->mesh, wall, DGFEM_R(1e-6), held, 4);
    dgfem_mesh_faces_on_plane(body->mesh, end, DGFEM_R(1e-6), tip, 4);
    dgfem_vec3 zero = {0, 0, 0};
    if (dgfem_body_fix_faces(body, held, 4, zero, NULL)) return 1;

    for (int step = 1; step <= 240; step++) {
        if (dgfem_body_step(body, DGFEM_R(1.0) / 60, NULL)) return 1;
        if (step % 30) continue;
        dgfem_vec3 u = dgfem_body_face_displacement(body, tip[0]);
        printf("%4.1f s: the tip has moved by (%.3f, %.3f, %.3f) m\n", body->time, (double)u.x, (double)u.y, (double)u.z);
    }
    dgfem_body_destroy(body);
    return 0;
}
