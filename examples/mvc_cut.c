/* A soft cube is subdivided by 30 random planes, each splitting one element through its middle, into 31 polyhedra, and
   falls on the ground (Wicke, Botsch, Gross 2007, figure 2). Prints one number a line; --ply FILE writes the picture:
   the elements drawn apart, the cube falling, at its flattest, and at the end. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"

#include "convex_mesh.h"
#include "picture.h"
#include "program.h"

typedef struct drop {
    double size, young, dt, height; /* m, Pa, s, m */
    int planes, steps, seed;
    const char *ply;
} drop;

static drop read_options(int argc, char **argv) {
    program p =
        program_begin(argc, argv,
                      "mvc_cut [--size 0.3] [--young 30000] [--planes 30] [--seed 1] [--height 0.25] [--dt 0.004]\n"
                      "  [--steps 250] [--ply FILE]");
    drop o;
    o.size = program_real(&p, "--size", 0.3);
    o.young = program_real(&p, "--young", 30000);
    o.planes = program_int(&p, "--planes", 30, 0, 1000);
    o.seed = program_int(&p, "--seed", 1, 0, 1000000);
    o.height = program_real(&p, "--height", 0.25);
    o.dt = program_real(&p, "--dt", 0.004);
    o.steps = program_int(&p, "--steps", 250, 1, 1000000);
    o.ply = program_text(&p, "--ply", NULL);
    program_end(&p);
    return o;
}

/* ---- the cube ---- */

/* Splits the largest element by a plane in a random direction through its centroid. */
static dgfem_status subdivide(const drop *o, dgfem_mvc *body) {
    uint64_t state = (uint64_t)o->seed;
    dgfem_mvc_cut_desc desc = dgfem_default_mvc_cut_desc();
    dgfem_status status = DGFEM_OK;
    desc.current = 0;
    for (int k = 0; !status && k < o->planes; k++) {
        int largest = 0;
        for (int e = 1; e < body->element_count; e++)
            if (body->volume[e] > body->volume[largest]) largest = e;
        dgfem_vec3 c = body->centre[largest];
        double z = convex_mesh_random(&state, -1, 1), turn = convex_mesh_random(&state, 0, 6.283185307179586);
        double x = sqrt(1 - z * z) * cos(turn), y = sqrt(1 - z * z) * sin(turn);
        double offset = x * (double)c.x + y * (double)c.y + z * (double)c.z;
        status = dgfem_mvc_split_element(body, largest, convex_mesh_plane(x, y, z, offset), &desc, NULL);
    }
    return status ? status : dgfem_mvc_check(body);
}

/* Turned a little, its lowest node `height` above the ground. */
static dgfem_status place(const drop *o, dgfem_mvc *body) {
    static const double turn[3][3] = {{0.8, 0.36, 0.48}, {0, 0.8, -0.6}, {-0.6, 0.48, 0.64}};
    dgfem_vec3 *x = (dgfem_vec3 *)malloc((size_t)body->node_count * sizeof *x);
    double lowest = INFINITY;
    if (!x) return DGFEM_ERROR_MEMORY;
    for (int i = 0; i < body->node_count; i++) {
        double r[3], p[3] = {0, 0, 0};
        r[0] = (double)body->rest[i].x, r[1] = (double)body->rest[i].y, r[2] = (double)body->rest[i].z;
        for (int k = 0; k < 9; k++) p[k / 3] += turn[k / 3][k % 3] * r[k % 3];
        x[i] = convex_mesh_vec3(p[0], p[1], p[2]);
        lowest = fmin(lowest, p[2]);
    }
    for (int i = 0; i < body->node_count; i++) x[i].z += (dgfem_real)(o->height - lowest);
    dgfem_status status = dgfem_mvc_set_positions(body, dgfem_points_in_vec3(x, body->node_count));
    free(x);
    return status;
}

static dgfem_mvc *create(const drop *o) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_mvc_desc desc = dgfem_default_mvc_desc();
    dgfem_shape_desc ground = dgfem_default_shape_desc();
    dgfem_mesh *mesh;
    dgfem_mvc *body = NULL;
    grid.lower = convex_mesh_vec3(-o->size / 2, -o->size / 2, -o->size / 2);
    grid.upper = convex_mesh_vec3(o->size / 2, o->size / 2, o->size / 2);
    grid.hooks = program_hooks();
    if (dgfem_mesh_create_grid(&grid, &mesh)) return NULL;
    desc.mesh = mesh;
    desc.material.young = (dgfem_real)o->young;
    desc.damping_stiffness = (dgfem_real)0.002;
    desc.stabilisation = (dgfem_real)0.1;
    desc.hooks = program_hooks();
    ground.friction = (dgfem_real)0.5;
    dgfem_status status = dgfem_mvc_create(&desc, &body);
    dgfem_mesh_destroy(mesh);
    if (!status) status = subdivide(o, body);
    if (!status) status = dgfem_mvc_add_plane(body, &ground, NULL);
    if (!status) status = place(o, body);
    if (!status) return body;
    dgfem_mvc_destroy(body);
    return NULL;
}

/* ---- picture ---- */

static picture_color element_color(int e) {
    double turn = 0.61803398875 * (e + 1), hue = 6.283185307179586 * (turn - floor(turn));
    return picture_rgb((int)(170 + 80 * cos(hue)), (int)(170 + 80 * cos(hue - 2.1)), (int)(170 + 80 * cos(hue + 2.1)));
}

/* One element, flat, all its faces, moved away from the middle of the cube by a part of its distance. */
static void add_element(picture *scene, const dgfem_mvc *body, int e, dgfem_vec3 shift, double apart) {
    int faces[256], triangles[3 * 256], owner[2];
    int count = dgfem_mvc_element_faces(body, e, faces, 256);
    dgfem_vec3 c = body->centre[e];
    for (int k = 0; k < count && k < 256; k++) {
        int found = dgfem_mvc_face_triangles(body, faces[k], triangles, 256);
        dgfem_mvc_face_elements(body, faces[k], owner);
        for (int t = 0; t < found && t < 256; t++) {
            dgfem_vec3 x[3];
            for (int i = 0; i < 3; i++) {
                int at = owner[0] == e ? i : 2 - i;
                dgfem_vec3 r = apart > 0 ? body->rest[triangles[3 * t + i]] : body->position[triangles[3 * t + i]];
                x[at].x = r.x + shift.x + (dgfem_real)apart * c.x;
                x[at].y = r.y + shift.y + (dgfem_real)apart * c.y;
                x[at].z = r.z + shift.z + (dgfem_real)apart * c.z;
            }
            picture_add_triangle(scene, x, element_color(e));
        }
    }
}

static void add_cube(picture *scene, const dgfem_mvc *body, dgfem_vec3 shift, double apart) {
    for (int e = 0; e < body->element_count; e++) add_element(scene, body, e, shift, apart);
}

static double lowest_top(const dgfem_mvc *body) {
    double top = -INFINITY;
    for (int i = 0; i < body->node_count; i++) top = fmax(top, (double)body->position[i].z);
    return top;
}

int main(int argc, char **argv) {
    drop o = read_options(argc, argv);
    dgfem_mvc *body = create(&o);
    dgfem_vec3 *flattest = NULL;
    picture scene;
    int least = INT_MAX, most = 0;
    memset(&scene, 0, sizeof scene);
    if (!body) return 1;
    flattest = (dgfem_vec3 *)malloc((size_t)body->node_count * sizeof *flattest);
    if (!flattest) return 1;
    for (int e = 0; e < body->element_count; e++) {
        int nodes = dgfem_mvc_element_nodes(body, e, NULL, 0);
        if (nodes < least) least = nodes;
        if (nodes > most) most = nodes;
    }
    add_cube(&scene, body, convex_mesh_vec3(0, 0, 1.05 * o.size), 0.7);
    add_cube(&scene, body, convex_mesh_vec3(2.2 * o.size, 0, 0), 0);
    double start = program_seconds(), top = INFINITY, volume = INFINITY;
    for (int step = 0; step < o.steps; step++) {
        if (dgfem_mvc_step(body, (dgfem_real)o.dt, NULL)) return 1;
        volume = fmin(volume, (double)dgfem_mvc_volume(body) / (double)dgfem_mvc_rest_volume(body));
        if (lowest_top(body) >= top || step > o.steps / 2) continue;
        top = lowest_top(body);
        memcpy(flattest, body->position, (size_t)body->node_count * sizeof *flattest);
    }
    double seconds = program_seconds() - start;
    add_cube(&scene, body, convex_mesh_vec3(6 * o.size, 0, 0), 0);
    if (dgfem_mvc_set_positions(body, dgfem_points_in_vec3(flattest, body->node_count))) return 1;
    add_cube(&scene, body, convex_mesh_vec3(4.1 * o.size, 0, 0), 0);
    picture_add_parallelogram(&scene, convex_mesh_vec3(-1.1 * o.size, -1.2 * o.size, 0),
                              convex_mesh_vec3(8.2 * o.size, 0, 0), convex_mesh_vec3(0, 2.4 * o.size, 0),
                              picture_rgb(245, 245, 240));
    printf("elements %d\nnodes %d\nleast_nodes_of_element %d\nmost_nodes_of_element %d\n", body->element_count,
           body->node_count, least, most);
    printf("flattest %.3f\nleast_volume %.3f\nmilliseconds_per_step %.2f\n", top / o.size, volume,
           1e3 * seconds / o.steps);
    int written = !o.ply || picture_write(&scene, o.ply);
    free(flattest);
    dgfem_mvc_destroy(body);
    return !written;
}
