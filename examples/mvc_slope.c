/* One element with 24 nodes, a soft truncated cube, falls on a slope, tumbles and slides down (Wicke, Botsch, Gross
   2007, figure 1). Prints one number a line; --ply FILE writes the picture: the element at several moments, octagons
   and triangles in two colours. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"

#include "convex_mesh.h"
#include "picture.h"
#include "program.h"

typedef struct slope {
    double size, young, angle, friction, height, dt; /* m, Pa, degrees, -, m above the slope, s */
    int steps, pictures;
    const char *ply;
} slope;

static slope read_options(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "mvc_slope [--size 0.2] [--young 12000] [--angle 22] [--friction 0.7] [--height 0.12]\n"
                              "  [--dt 0.004] [--steps 500] [--pictures 6] [--ply FILE]");
    slope o;
    o.size = program_real(&p, "--size", 0.2);
    o.young = program_real(&p, "--young", 12000);
    o.angle = program_real(&p, "--angle", 22);
    o.friction = program_real(&p, "--friction", 0.7);
    o.height = program_real(&p, "--height", 0.12);
    o.dt = program_real(&p, "--dt", 0.004);
    o.steps = program_int(&p, "--steps", 500, 1, 1000000);
    o.pictures = program_int(&p, "--pictures", 6, 2, 100);
    o.ply = program_text(&p, "--ply", NULL);
    program_end(&p);
    return o;
}

static dgfem_vec3 downhill(const slope *o) {
    double a = o->angle * 3.14159265358979 / 180;
    return convex_mesh_vec3(cos(a), 0, -sin(a));
}

static dgfem_vec3 uphill_normal(const slope *o) {
    double a = o->angle * 3.14159265358979 / 180;
    return convex_mesh_vec3(sin(a), 0, cos(a));
}

static double along(dgfem_vec3 a, dgfem_vec3 b) { return (double)(a.x * b.x + a.y * b.y + a.z * b.z); }

/* ---- the element ---- */

/* A cube whose corners are cut off so that its sides become regular octagons. */
static dgfem_status make_mesh(const slope *o, dgfem_mesh **mesh) {
    const double edge = sqrt(2.0) - 1; /* of the octagons, half of it, by half the cube */
    double half = o->size / 2;
    dgfem_polyhedron *cell;
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_status status = convex_mesh_box(-half, half, &cell);
    *mesh = NULL;
    for (int corner = 0; !status && corner < 8; corner++) {
        dgfem_polyhedron *below, *above;
        dgfem_plane plane =
            convex_mesh_plane(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1, (2 + edge) * half);
        status = dgfem_polyhedron_split(cell, plane, &below, &above);
        if (status) break;
        dgfem_polyhedron_destroy(cell);
        dgfem_polyhedron_destroy(above);
        cell = below;
    }
    if (!status) status = dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)&cell, 1, &weld, mesh);
    if (!status || cell) dgfem_polyhedron_destroy(cell);
    return status;
}

/* Turned at will, its lowest point `height` above the slope, which passes through the origin. */
static dgfem_status place(const slope *o, dgfem_mvc *body) {
    static const double turn[3][3] = {{0.8, -0.6, 0}, {0.48, 0.64, -0.6}, {0.36, 0.48, 0.8}};
    dgfem_vec3 *x = (dgfem_vec3 *)malloc((size_t)body->node_count * sizeof *x), up = uphill_normal(o);
    double lowest = INFINITY;
    if (!x) return DGFEM_ERROR_MEMORY;
    for (int i = 0; i < body->node_count; i++) {
        double r[3], p[3] = {0, 0, 0};
        r[0] = (double)body->rest[i].x, r[1] = (double)body->rest[i].y, r[2] = (double)body->rest[i].z;
        for (int k = 0; k < 9; k++) p[k / 3] += turn[k / 3][k % 3] * r[k % 3];
        x[i] = convex_mesh_vec3(p[0], p[1], p[2]);
        lowest = fmin(lowest, along(x[i], up));
    }
    for (int i = 0; i < body->node_count; i++) {
        double lift = o->height - lowest;
        x[i] = convex_mesh_vec3((double)x[i].x + lift * (double)up.x, (double)x[i].y,
                                (double)x[i].z + lift * (double)up.z);
    }
    dgfem_status status = dgfem_mvc_set_positions(body, dgfem_points_in_vec3(x, body->node_count));
    free(x);
    return status;
}

static dgfem_mvc *create(const slope *o) {
    dgfem_mvc_desc desc = dgfem_default_mvc_desc();
    dgfem_shape_desc ground = dgfem_default_shape_desc();
    dgfem_mesh *mesh;
    dgfem_mvc *body = NULL;
    if (make_mesh(o, &mesh)) return fprintf(stderr, "no element of size %g\n", o->size), (dgfem_mvc *)NULL;
    desc.mesh = mesh;
    desc.material.young = (dgfem_real)o->young;
    desc.damping_stiffness = (dgfem_real)0.002;
    desc.hooks = program_hooks();
    ground.plane.normal = uphill_normal(o);
    ground.friction = (dgfem_real)o->friction;
    dgfem_status status = dgfem_mvc_create(&desc, &body);
    if (!status) status = dgfem_mvc_add_plane(body, &ground, NULL);
    if (!status) status = place(o, body);
    dgfem_mesh_destroy(mesh);
    if (!status) return body;
    dgfem_mvc_destroy(body);
    return NULL;
}

/* ---- picture ---- */

/* The element as it is now: its triangles, flat; those of octagons and of corners in two colours. */
static void add_element(picture *scene, dgfem_mvc_surface *surface, const dgfem_mvc *body) {
    if (dgfem_mvc_surface_update(surface, body)) return;
    for (int t = 0; t < surface->triangle_count; t++) {
        int corner = dgfem_mvc_face_nodes(body, surface->face[t], NULL, 0) == 3;
        dgfem_vec3 x[3];
        for (int i = 0; i < 3; i++) x[i] = surface->positions[surface->triangles[3 * t + i]];
        picture_add_triangle(scene, x, corner ? picture_rgb(90, 160, 255) : picture_rgb(255, 180, 80));
    }
}

static void add_slope(const slope *o, picture *scene, double length) {
    dgfem_vec3 d = downhill(o);
    double start = -1.2 * o->size, width = 1.4 * o->size, whole = length - start + 1.6 * o->size;
    dgfem_vec3 a = convex_mesh_vec3(start * (double)d.x, -width, start * (double)d.z);
    picture_add_parallelogram(scene, a, convex_mesh_vec3(whole * (double)d.x, 0, whole * (double)d.z),
                              convex_mesh_vec3(0, 2 * width, 0), picture_rgb(245, 245, 240));
}

/* ---- motion ---- */

static dgfem_vec3 centre(const dgfem_mvc *body) {
    double sum[3] = {0, 0, 0}, mass = (double)dgfem_mvc_mass(body);
    for (int i = 0; i < body->node_count; i++) {
        double m = (double)body->mass[i] / mass;
        sum[0] += m * (double)body->position[i].x, sum[1] += m * (double)body->position[i].y;
        sum[2] += m * (double)body->position[i].z;
    }
    return convex_mesh_vec3(sum[0], sum[1], sum[2]);
}

int main(int argc, char **argv) {
    slope o = read_options(argc, argv);
    dgfem_mvc *body = create(&o);
    dgfem_mvc_surface *surface = NULL;
    picture scene;
    memset(&scene, 0, sizeof scene);
    if (!body || dgfem_mvc_surface_create(body, &surface)) return 1;
    double start = program_seconds(), least = 1, largest = 1, from = along(centre(body), downhill(&o)), to = from;
    int contacts = 0, shown = 0;
    if (o.ply) add_element(&scene, surface, body);
    for (int step = 1; step <= o.steps; step++) {
        dgfem_mvc_info info;
        if (dgfem_mvc_step(body, (dgfem_real)o.dt, &info)) return 1;
        double volume = (double)dgfem_mvc_volume(body) / (double)dgfem_mvc_rest_volume(body);
        least = fmin(least, volume), largest = fmax(largest, volume);
        contacts = info.contacts > contacts ? info.contacts : contacts;
        to = along(centre(body), downhill(&o));
        /* one after the other down the slope, 1.75 sizes apart */
        if (!o.ply || shown + 1 >= o.pictures || to - from < 1.75 * o.size * (shown + 1)) continue;
        shown++;
        add_element(&scene, surface, body);
    }
    printf("elements %d\nnodes %d\nsteps %d\ntravel %.4f\nmost_contacts %d\n", body->element_count, body->node_count,
           o.steps, to - from, contacts);
    printf("least_volume %.4f\nlargest_volume %.4f\nmicroseconds_per_step %.1f\n", least, largest,
           1e6 * (program_seconds() - start) / o.steps);
    if (o.ply) add_slope(&o, &scene, from + 1.75 * o.size * shown);
    int written = !o.ply || picture_write(&scene, o.ply);
    dgfem_mvc_surface_destroy(surface);
    dgfem_mvc_destroy(body);
    return !written;
}
