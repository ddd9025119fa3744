/* A soft block of 3 x 3 x 3 elements, held on one side, is sliced from the other by blades that come one after the
   other on curved paths; the slices bend under their weight (Wicke, Botsch, Gross 2007, figure 9). Each blade cuts the
   surface that it sweeps in the current, moving block. Prints one number a line; --ply FILE writes the picture: the
   block before, half cut and at the end, walls of cuts in their own colour. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"

#include "convex_mesh.h"
#include "picture.h"
#include "program.h"

typedef struct slicing {
    double size, young, dt, depth, bow; /* m, Pa, s; parts of the size */
    int blades, stages, steps_each, rest_steps;
    const char *ply;
} slicing;

typedef struct counts {
    int cuts, split, slivers, left, pieces;
    double cut_seconds, worst_cut, step_seconds;
    int steps;
} counts;

static slicing read_options(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "mvc_slice [--size 0.3] [--young 150000] [--blades 3] [--stages 3] [--steps-each 15]\n"
                              "  [--rest-steps 120] [--dt 0.01] [--depth 0.85] [--bow 0.06] [--ply FILE]");
    slicing o;
    o.size = program_real(&p, "--size", 0.3);
    o.young = program_real(&p, "--young", 150000);
    o.blades = program_int(&p, "--blades", 3, 1, 20);
    o.stages = program_int(&p, "--stages", 3, 1, 60);
    o.steps_each = program_int(&p, "--steps-each", 15, 0, 1000);
    o.rest_steps = program_int(&p, "--rest-steps", 120, 0, 1000000);
    o.dt = program_real(&p, "--dt", 0.01);
    o.depth = program_real(&p, "--depth", 0.85);
    o.bow = program_real(&p, "--bow", 0.06);
    o.ply = program_text(&p, "--ply", NULL);
    program_end(&p);
    return o;
}

/* ---- the block ---- */

static dgfem_mvc *create(const slicing *o) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_mvc_desc desc = dgfem_default_mvc_desc();
    dgfem_mesh *mesh;
    dgfem_mvc *body = NULL;
    int nodes[64];
    for (int k = 0; k < 3; k++) grid.cells[k] = 3;
    grid.lower = convex_mesh_vec3(0, 0, 0);
    grid.upper = convex_mesh_vec3(o->size, o->size, o->size);
    grid.hooks = program_hooks();
    if (dgfem_mesh_create_grid(&grid, &mesh)) return NULL;
    desc.mesh = mesh;
    desc.material.young = (dgfem_real)o->young;
    desc.material.poisson = (dgfem_real)0.4;
    desc.damping_stiffness = (dgfem_real)0.01;
    desc.stabilisation = (dgfem_real)0.1;
    desc.hooks = program_hooks();
    dgfem_status status = dgfem_mvc_create(&desc, &body);
    dgfem_mesh_destroy(mesh);
    if (status) return NULL;
    int count = dgfem_mvc_nodes_on_plane(body, convex_mesh_plane(1, 0, 0, 0), (dgfem_real)(1e-6 * o->size), nodes, 64);
    if (!dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, convex_mesh_vec3(0, 0, 0), NULL)) return body;
    dgfem_mvc_destroy(body);
    return NULL;
}

/* ---- the blades ---- */

/* Where the edge of a blade is when it has gone a part t of its way: a line along y. Slices become thicker upwards. */
static void blade_edge(const slicing *o, int blade, double t, dgfem_vec3 edge[2]) {
    double part = (blade + 1.0) / (o->blades + 1), x = 1.15 - (o->depth + 0.15) * t;
    double z = part * (0.6 + 0.4 * part) + o->bow * sin(3.14159265358979 * t);
    for (int k = 0; k < 2; k++) edge[k] = convex_mesh_vec3(o->size * x, o->size * (k ? 1.3 : -0.3), o->size * z);
}

static dgfem_status cut(const slicing *o, dgfem_mvc *body, int blade, counts *n) {
    dgfem_mvc_cut_info info;
    dgfem_vec3 corners[2 * 61];
    int triangles[6 * 60];
    double start = program_seconds();
    for (int k = 0; k <= o->stages; k++) blade_edge(o, blade, (double)k / o->stages, corners + 2 * k);
    for (int k = 0; k < o->stages; k++) {
        static const int pattern[6] = {0, 1, 2, 1, 3, 2};
        for (int i = 0; i < 6; i++) triangles[6 * k + i] = 2 * k + pattern[i];
    }
    dgfem_points_in points = dgfem_points_in_vec3(corners, 2 * (o->stages + 1));
    dgfem_status status = dgfem_mvc_cut_surface(body, points, triangles, 2 * o->stages, NULL, &info);
    if (!status) status = dgfem_mvc_check(body);
    double seconds = program_seconds() - start;
    n->cuts++;
    n->split += info.elements_split, n->slivers += info.slivers_removed, n->left = info.slivers_left;
    n->pieces = info.pieces;
    n->cut_seconds += seconds, n->worst_cut = fmax(n->worst_cut, seconds);
    return status;
}

static dgfem_status steps(const slicing *o, dgfem_mvc *body, int count, counts *n) {
    double start = program_seconds();
    dgfem_status status = DGFEM_OK;
    for (int i = 0; !status && i < count; i++) status = dgfem_mvc_step(body, (dgfem_real)o->dt, NULL);
    n->step_seconds += program_seconds() - start;
    n->steps += count;
    return status;
}

/* ---- picture ---- */

/* The block as it is now, moved along x. */
static int add_block(picture *scene, const dgfem_mvc *body, double shift) {
    dgfem_mvc_surface *surface;
    if (dgfem_mvc_surface_create(body, &surface)) return 0;
    int *wall = (int *)malloc((size_t)surface->triangle_count * sizeof(int));
    if (!wall) return dgfem_mvc_surface_destroy(surface), 0;
    for (int i = 0; i < surface->vertex_count; i++) surface->positions[i].x += (dgfem_real)shift;
    for (int t = 0; t < surface->triangle_count; t++) wall[t] = dgfem_mvc_face_is_wall(body, surface->face[t]);
    picture_add_mesh(scene, surface->positions, surface->normals, surface->vertex_count, surface->triangles, wall,
                     surface->triangle_count, picture_rgb(90, 160, 255), picture_rgb(255, 150, 90));
    free(wall);
    dgfem_mvc_surface_destroy(surface);
    return 1;
}

int main(int argc, char **argv) {
    slicing o = read_options(argc, argv);
    dgfem_mvc *body = create(&o);
    dgfem_status status = DGFEM_OK;
    picture scene;
    counts n;
    memset(&scene, 0, sizeof scene);
    memset(&n, 0, sizeof n);
    if (!body) return 1;
    printf("start_nodes %d\nstart_elements %d\n", body->node_count, body->element_count);
    if (!add_block(&scene, body, 0)) return 1;
    for (int blade = 0; !status && blade < o.blades; blade++) {
        status = cut(&o, body, blade, &n);
        if (!status) status = steps(&o, body, o.steps_each, &n);
        if (blade == o.blades / 2 && !add_block(&scene, body, 1.6 * o.size)) return 1;
    }
    if (!status) status = steps(&o, body, o.rest_steps, &n);
    if (status) return fprintf(stderr, "%s\n", dgfem_status_text(status)), 1;
    if (!add_block(&scene, body, 3.2 * o.size)) return 1;
    printf("nodes %d\nelements %d\npieces %d\ncuts %d\nelements_split %d\nslivers_removed %d\n", body->node_count,
           body->element_count, n.pieces, n.cuts, n.split, n.slivers);
    printf("volume_error %.2e\n", fabs((double)dgfem_mvc_rest_volume(body) / pow(o.size, 3) - 1));
    printf("milliseconds_per_cut %.2f\nmilliseconds_worst_cut %.2f\nmilliseconds_per_step %.2f\n",
           1e3 * n.cut_seconds / n.cuts, 1e3 * n.worst_cut, 1e3 * n.step_seconds / n.steps);
    int written = !o.ply || picture_write(&scene, o.ply);
    dgfem_mvc_destroy(body);
    return !written;
}
