/* Table 1 of Wicke, Botsch and Gross 2007, scene by scene as far as the paper describes them, beside what it prints
   (Pentium 4, 3 GHz). A frame is one time step and the cuts before it; "dynamics" leaves out cuts and integrals of
   basis functions, as the paper's times in parentheses do, but has the analysis of the linear system after a cut.

   Figure 10's mesh is not published: the bunny comes from build/bunny.obj where that exists, its tetrahedra from a
   lattice of about as many as the paper's (which prints 24079 nodes and 8278 elements, by all likelihood the other way
   round); nor are the paths of its blades, nor those of figure 9. The numbers of nodes and elements at the end tell how
   far the scenes agree. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"

#include "convex_mesh.h"
#include "lattice.h"
#include "model.h"
#include "program.h"

typedef struct timing {
    double cuts, steps;
    int frames, start_nodes, start_elements;
} timing;

/* What the paper prints, as text. */
typedef struct printed {
    const char *figure, *start, *end, *seconds;
} printed;

static timing begin(const dgfem_mvc *body) {
    timing t;
    memset(&t, 0, sizeof t);
    t.start_nodes = body->node_count, t.start_elements = body->element_count;
    return t;
}

static int step(dgfem_mvc *body, double dt, timing *t) {
    double start = program_seconds();
    dgfem_status status = dgfem_mvc_step(body, (dgfem_real)dt, NULL);
    t->steps += program_seconds() - start;
    t->frames++;
    return !status;
}

static void print_row(const printed *paper, const dgfem_mvc *body, const timing *t) {
    char start[32], end[32], seconds[32];
    double frame = (t->cuts + t->steps) / t->frames, dynamics = t->steps / t->frames;
    snprintf(start, sizeof start, "%d / %d", t->start_nodes, t->start_elements);
    snprintf(end, sizeof end, "%d / %d", body->node_count, body->element_count);
    if (t->cuts > 0) snprintf(seconds, sizeof seconds, "%.2g (%.2g)", frame, dynamics);
    else snprintf(seconds, sizeof seconds, "%.2g", frame);
    printf("| %s | %s | %s | %s | %s | %s | %s |\n", paper->figure, paper->start, start, paper->end, end,
           paper->seconds, seconds);
    fflush(stdout);
}

/* ---- bodies ---- */

/* Falls from `height` over the ground, or is held at x = 0 where that is negative. */
static dgfem_mvc *make_body(dgfem_mesh *mesh, double young, double height) {
    dgfem_mvc_desc desc = dgfem_default_mvc_desc();
    dgfem_shape_desc ground = dgfem_default_shape_desc();
    dgfem_mvc *body = NULL;
    double lowest = INFINITY;
    int *nodes;
    desc.mesh = mesh;
    desc.material.young = (dgfem_real)young;
    desc.damping_stiffness = DGFEM_R(0.005);
    desc.stabilisation = DGFEM_R(0.1);
    desc.hooks = program_hooks();
    for (int v = 0; mesh && v < mesh->vertex_count; v++) lowest = fmin(lowest, (double)mesh->vertices[v].z);
    ground.plane.offset = (dgfem_real)(lowest - height);
    ground.friction = DGFEM_R(0.5);
    dgfem_status status = mesh ? dgfem_mvc_create(&desc, &body) : DGFEM_ERROR_ARGUMENT;
    dgfem_mesh_destroy(mesh);
    if (status) return NULL;
    if (height >= 0) return dgfem_mvc_add_plane(body, &ground, NULL) ? NULL : body;
    nodes = (int *)malloc((size_t)body->node_count * sizeof *nodes);
    if (!nodes) return NULL;
    int count = dgfem_mvc_nodes_on_plane(body, convex_mesh_plane(1, 0, 0, 0), DGFEM_R(1e-6), nodes, body->node_count);
    status = dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, convex_mesh_vec3(0, 0, 0), NULL);
    free(nodes);
    return status ? NULL : body;
}

static dgfem_mesh *cube(int cells, double size) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_mesh *mesh = NULL;
    for (int k = 0; k < 3; k++) grid.cells[k] = cells;
    grid.upper = convex_mesh_vec3(size, size, size);
    return dgfem_mesh_create_grid(&grid, &mesh) ? NULL : mesh;
}

/* A cube of which each corner is cut off: 24 nodes. */
static dgfem_mesh *truncated_cube(void) {
    dgfem_polyhedron *cell, *below, *above;
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_mesh *mesh = NULL;
    if (convex_mesh_box(-1, 1, &cell)) return NULL;
    for (int c = 0; c < 8; c++) {
        dgfem_plane plane = convex_mesh_plane(c & 1 ? 1 : -1, c & 2 ? 1 : -1, c & 4 ? 1 : -1, 1 + sqrt(2));
        if (dgfem_polyhedron_split(cell, plane, &below, &above)) break;
        dgfem_polyhedron_destroy(cell);
        dgfem_polyhedron_destroy(above);
        cell = below;
    }
    if (dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)&cell, 1, &weld, &mesh)) mesh = NULL;
    dgfem_polyhedron_destroy(cell);
    return mesh;
}

static dgfem_mesh *bunny(int cells) {
    FILE *file = fopen("build/bunny.obj", "r");
    formats_surface surface;
    formats_tetrahedra tetrahedra;
    dgfem_mesh *mesh = NULL;
    int ok = model_read(file && fgetc(file) != EOF ? "build/bunny.obj" : NULL, &surface);
    if (file) fclose(file);
    if (!ok) return NULL;
    ok = lattice_fill(&surface, cells, &tetrahedra);
    formats_free_surface(&surface);
    if (!ok) return NULL;
    if (formats_tetrahedra_mesh(&tetrahedra, NULL, &mesh)) mesh = NULL;
    formats_free_tetrahedra(&tetrahedra);
    return mesh;
}

/* ---- scenes ---- */

static int run_element(void) {
    static const printed paper = {"1", "24 / 1", "24 / 1", "0.012"};
    dgfem_mvc *body = make_body(truncated_cube(), 3e4, 0.5);
    if (!body) return 0;
    timing t = begin(body);
    while (t.frames < 2000)
        if (!step(body, 0.005, &t)) return 0;
    print_row(&paper, body, &t);
    dgfem_mvc_destroy(body);
    return 1;
}

/* Each of 30 planes splits the largest element, before the clock starts. */
static int run_planes(void) {
    static const printed paper = {"2", "184 / 31", "184 / 31", "0.22"};
    dgfem_mvc_cut_desc desc = dgfem_default_mvc_cut_desc();
    dgfem_mvc *body = make_body(cube(1, 0.3), 3e4, 0.25);
    uint64_t state = 1;
    desc.current = 0;
    for (int k = 0; body && k < 30; k++) {
        int largest = 0;
        for (int e = 1; e < body->element_count; e++)
            if (body->volume[e] > body->volume[largest]) largest = e;
        dgfem_vec3 c = body->centre[largest];
        double z = convex_mesh_random(&state, -1, 1), turn = convex_mesh_random(&state, 0, 6.283185307179586);
        double x = sqrt(1 - z * z) * cos(turn), y = sqrt(1 - z * z) * sin(turn);
        dgfem_plane plane = convex_mesh_plane(x, y, z, x * (double)c.x + y * (double)c.y + z * (double)c.z);
        if (dgfem_mvc_split_element(body, largest, plane, &desc, NULL)) return 0;
    }
    if (!body) return 0;
    timing t = begin(body);
    while (t.frames < 300)
        if (!step(body, 0.004, &t)) return 0;
    print_row(&paper, body, &t);
    dgfem_mvc_destroy(body);
    return 1;
}

/* Three blades, each swept on a curve in six frames, a strip of two triangles in each. */
static int run_block(void) {
    static const printed paper = {"9", "64 / 27", "1214 / 60", "0.8 (0.04)"};
    enum { STAGES = 6 };
    static const int triangles[6] = {0, 1, 2, 1, 3, 2};
    const double size = 0.3;
    dgfem_mvc *body = make_body(cube(3, size), 1.5e5, -1);
    if (!body) return 0;
    timing t = begin(body);
    for (int blade = 0; blade < 3; blade++)
        for (int stage = 0; stage < STAGES; stage++) {
            dgfem_vec3 corners[4];
            double start = program_seconds();
            for (int k = 0; k < 4; k++) {
                double way = (double)(stage + k / 2) / STAGES, part = 0.25 * (blade + 1);
                corners[k] = convex_mesh_vec3(size * (1.15 - way), size * (k % 2 ? 1.3 : -0.3),
                                              size * (part + 0.06 * sin(3.14159265358979 * way)));
            }
            if (dgfem_mvc_cut_surface(body, dgfem_points_in_vec3(corners, 4), triangles, 2, NULL, NULL)) return 0;
            t.cuts += program_seconds() - start;
            if (!step(body, 0.002, &t)) return 0;
        }
    print_row(&paper, body, &t);
    dgfem_mvc_destroy(body);
    return 1;
}

/* Upright planes go through the falling bunny one after the other, each in four frames. */
static int run_bunny(void) {
    static const printed paper = {"10", "8278 / 24079", "46132 / 44118", "6.08 (3.56)"};
    enum { SLICES = 16, STAGES = 4 };
    dgfem_mvc *body = make_body(bunny(21), 2e5, 2);
    if (!body) return 0;
    timing t = begin(body);
    for (int frame = 0; frame < SLICES * STAGES; frame++) {
        double start = program_seconds(), lower = INFINITY, upper = -INFINITY, x;
        dgfem_vec3 corners[4];
        for (int i = 0; i < body->node_count; i++)
            lower = fmin(lower, (double)body->rest[i].x), upper = fmax(upper, (double)body->rest[i].x);
        x = lower + (frame / STAGES + 1) * (upper - lower) / (SLICES + 1);
        for (int k = 0; k < 4; k++)
            corners[k] = convex_mesh_vec3(x, k == 1 || k == 2 ? -0.6 + 1.2 * (frame % STAGES + 1) / STAGES : -0.7,
                                          k < 2 ? -3 : 3);
        if (dgfem_mvc_cut_polygon(body, dgfem_points_in_vec3(corners, 4), NULL, NULL)) return 0;
        t.cuts += program_seconds() - start;
        if (!step(body, 0.002, &t)) return 0;
    }
    print_row(&paper, body, &t);
    dgfem_mvc_destroy(body);
    return 1;
}

int main(void) {
    printf("nodes / elements, and seconds per frame (of those, dynamics), the paper's first in each pair\n\n");
    printf("| figure | start, paper | here | end, paper | here | seconds, paper | here |\n");
    printf("|---|---|---|---|---|---|---|\n");
    return !(run_element() && run_planes() && run_block() && run_bunny());
}
