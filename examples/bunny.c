/* A soft bunny, sliced into polyhedra by a grid, tumbles down a slope and comes to rest.

   Writes into the folder --out: skin_NNNN.obj (the smooth skin) and elements_NNNN.vtu (the polyhedra with their stress)
   for every frame, and scene.ply (the slope and the skin at several moments in one picture). */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include <sys/stat.h>

#include "formats.h"
#include "program.h"

typedef struct options {
    const char *model, *out;
    int cells, frame_every, write_frames;
    double seconds, dt, young, slope;
    dgfem_solver solver;
} options;

typedef struct scene {
    formats_surface surface;
    dgfem_slice_info slices;
    dgfem_body *body;
    dgfem_skin *skin;
    double milliseconds_slice;
} scene;

/* What the run has measured so far. */
typedef struct statistics {
    int steps, frames, contacts;
    double assemble, contact, factor, solve, skin; /* seconds */
    double volume_start, volume_drift;             /* largest relative change */
    double kinetic_peak, kinetic_last, last_second_speed;
} statistics;

static options read_options(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "bunny [--model FILE] [--out build/demo] [--cells 11] [--seconds 12] [--dt 0.0166667]\n"
                              "  [--young 4e5] [--slope 30] [--frame-every 3] [--no-frames]\n"
                              "  [--solver cholesky|pcg]");
    options o;
    o.model = program_text(&p, "--model", NULL);
    o.out = program_text(&p, "--out", "build/demo");
    o.cells = program_int(&p, "--cells", 11, 1, 1000);
    o.seconds = program_real(&p, "--seconds", 12);
    o.dt = program_real(&p, "--dt", 1.0 / 60);
    o.young = program_real(&p, "--young", 4e5);
    o.slope = program_real(&p, "--slope", 30);
    o.solver = program_choice(&p, "--solver", "cholesky|pcg", 0) ? DGFEM_SOLVER_PCG : DGFEM_SOLVER_CHOLESKY;
    o.frame_every = program_int(&p, "--frame-every", 3, 1, 1000000);
    o.write_frames = !program_flag(&p, "--no-frames");
    program_end(&p);
    return o;
}

/* ---- the model ---- */

/* Where no model is given: a sphere of latitudes and longitudes with five bumps around its waist and two horns. */
static int make_builtin_surface(formats_surface *surface) {
    enum { RINGS = 30, SECTORS = 60 };
    const double pi = 3.14159265358979323846;
    int n = 0;
    surface->vertex_count = (RINGS - 1) * SECTORS + 2;
    surface->triangle_count = 2 * (RINGS - 1) * SECTORS;
    surface->vertices = (double *)malloc((size_t)surface->vertex_count * 3 * sizeof(double));
    surface->triangles = (int *)malloc((size_t)surface->triangle_count * 3 * sizeof(int));
    if (!surface->vertices || !surface->triangles) return 0;
    for (int v = 0; v < surface->vertex_count; v++) {
        int is_pole = v >= (RINGS - 1) * SECTORS;
        double polar = is_pole ? (v == surface->vertex_count - 1 ? pi : 0) : pi * (v / SECTORS + 1) / RINGS;
        double around = is_pole ? 0 : 2 * pi * (v % SECTORS) / SECTORS;
        double horn = exp(-40 * ((polar - 0.7) * (polar - 0.7) + cos(around) * cos(around)));
        double r = 1 + 0.2 * pow(sin(polar), 5) * cos(5 * around) + 0.8 * horn;
        surface->vertices[3 * v] = r * sin(polar) * cos(around);
        surface->vertices[3 * v + 2] = r * sin(polar) * sin(around);
        surface->vertices[3 * v + 1] = r * cos(polar);
    }
    for (int ring = -1; ring < RINGS - 1; ring++)
        for (int s = 0; s < SECTORS; s++) {
            int north = (RINGS - 1) * SECTORS, south = north + 1, next = (s + 1) % SECTORS;
            int a = ring < 0 ? north : ring * SECTORS + s, b = ring < 0 ? north : ring * SECTORS + next;
            int c = ring == RINGS - 2 ? south : (ring + 1) * SECTORS + s;
            int d = ring == RINGS - 2 ? south : (ring + 1) * SECTORS + next;
            int corners[2][3] = {{a, b, d}, {a, d, c}};
            for (int t = 0; t < 2; t++)
                if (corners[t][0] != corners[t][1] && corners[t][1] != corners[t][2] && corners[t][0] != corners[t][2]) {
                    memcpy(surface->triangles + 3 * n, corners[t], sizeof corners[t]);
                    n++;
                }
        }
    surface->triangle_count = n;
    return 1;
}

/* From y up to z up, one metre tall, standing on the origin. */
static void normalize(formats_surface *surface) {
    double lower[3] = {1e300, 1e300, 1e300}, upper[3] = {-1e300, -1e300, -1e300};
    for (int v = 0; v < surface->vertex_count; v++) {
        double *x = surface->vertices + 3 * v, y = x[1];
        x[1] = -x[2], x[2] = y;
        for (int k = 0; k < 3; k++) lower[k] = fmin(lower[k], x[k]), upper[k] = fmax(upper[k], x[k]);
    }
    double scale = 1 / (upper[2] - lower[2]);
    for (int v = 0; v < surface->vertex_count; v++) {
        double *x = surface->vertices + 3 * v;
        x[0] = (x[0] - (lower[0] + upper[0]) / 2) * scale;
        x[1] = (x[1] - (lower[1] + upper[1]) / 2) * scale;
        x[2] = (x[2] - lower[2]) * scale;
    }
}

static int read_model(const options *o, formats_surface *surface) {
    formats_error error;
    memset(surface, 0, sizeof *surface);
    if (!o->model) {
        printf("no model given: a built-in shape it is\n");
        return make_builtin_surface(surface);
    }
    if (formats_read_surface(o->model, surface, &error)) return 1;
    fprintf(stderr, "%s\n", error.text);
    return 0;
}

/* ---- the scene ---- */

static int make_body(const options *o, scene *s) {
    dgfem_slice_desc slice = dgfem_default_slice_desc();
    dgfem_body_desc desc = dgfem_default_body_desc();
    slice.vertices = dgfem_points_in_double(s->surface.vertices, s->surface.vertex_count);
    slice.triangles = s->surface.triangles;
    slice.triangle_count = s->surface.triangle_count;
    slice.cells = o->cells;
    slice.info = &s->slices;
    slice.hooks = program_hooks();
    double start = program_seconds();
    if (dgfem_mesh_create_slices(&slice, &desc.mesh)) return 0;
    s->milliseconds_slice = 1e3 * (program_seconds() - start);
    desc.material.young = (dgfem_real)o->young;
    desc.material.poisson = DGFEM_R(0.4);
    desc.eta_rest = DGFEM_R(0.7); /* (1 + nu)/2: the ears are one element thick */
    desc.solver = o->solver;
    desc.damping_stiffness = DGFEM_R(0.02);
    desc.damping_mass = 1; /* the air; without it the bunny rocks on its back for long */
    desc.hooks = program_hooks();
    if (!dgfem_body_create(&desc, &s->body)) return 1;
    dgfem_mesh_destroy(desc.mesh);
    return 0;
}

static int make_skin(scene *s) {
    dgfem_skin_desc desc = dgfem_default_skin_desc();
    desc.vertices = dgfem_points_in_double(s->surface.vertices, s->surface.vertex_count);
    desc.triangles = s->surface.triangles;
    desc.triangle_count = s->surface.triangle_count;
    desc.hooks = program_hooks();
    return dgfem_skin_create(s->body, &desc, &s->skin) == DGFEM_OK;
}

/* The skin's vertices are what touches: each stands for a third of the triangles around it. */
static int make_contact_points(scene *s) {
    dgfem_real *areas = (dgfem_real *)calloc((size_t)s->surface.vertex_count, sizeof *areas);
    if (!areas) return 0;
    for (int t = 0; t < s->surface.triangle_count; t++) {
        const int *corner = s->surface.triangles + 3 * t;
        const double *a = s->surface.vertices + 3 * corner[0], *b = s->surface.vertices + 3 * corner[1];
        const double *c = s->surface.vertices + 3 * corner[2];
        double u[3], v[3];
        for (int k = 0; k < 3; k++) u[k] = b[k] - a[k], v[k] = c[k] - a[k];
        double x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2], z = u[0] * v[1] - u[1] * v[0];
        for (int k = 0; k < 3; k++) areas[corner[k]] += (dgfem_real)(sqrt(x * x + y * y + z * z) / 6);
    }
    dgfem_points_in points = dgfem_points_in_double(s->surface.vertices, s->surface.vertex_count);
    dgfem_status status = dgfem_body_set_contact_points(s->body, points, areas);
    free(areas);
    return status == DGFEM_OK;
}

/* A slope down to x = 0, and the floor z = 0 behind it. The bunny starts above the slope with a little spin. */
static int place(const options *o, scene *s) {
    const double angle = o->slope * 3.14159265358979323846 / 180, start_x = -2.4;
    dgfem_shape_desc slope = dgfem_default_shape_desc(), floor = dgfem_default_shape_desc();
    dgfem_mat3 none = {{{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}, spin = {{{0, 0, 3}, {0, 0, 0}, {-3, 0, 0}}};
    dgfem_vec3 start = {0, 0, 0}, speed = {0, 0, 0};
    slope.plane.normal.x = (dgfem_real)sin(angle), slope.plane.normal.z = (dgfem_real)cos(angle);
    slope.friction = floor.friction = DGFEM_R(0.6);
    if (dgfem_body_add_plane(s->body, &slope, NULL) || dgfem_body_add_plane(s->body, &floor, NULL)) return 0;
    start.x = (dgfem_real)start_x, start.z = (dgfem_real)(0.6 - start_x * tan(angle));
    speed.x = 1 - 3 * DGFEM_R(0.5); /* the spin turns about the middle of the bunny */
    return !dgfem_body_set_affine(s->body, none, start) && !dgfem_body_set_affine_velocity(s->body, spin, speed);
}

static int make_scene(const options *o, scene *s) {
    memset(s, 0, sizeof *s);
    if (!read_model(o, &s->surface)) return 0;
    normalize(&s->surface);
    return make_body(o, s) && make_skin(s) && make_contact_points(s) && place(o, s);
}

static void destroy_scene(scene *s) {
    dgfem_skin_destroy(s->skin);
    dgfem_body_destroy(s->body);
    formats_free_surface(&s->surface);
}

/* ---- output ---- */

static dgfem_vec3 deformed(void *user, int element, int vertex) {
    const dgfem_body *body = (const dgfem_body *)user;
    dgfem_vec3 x = body->mesh->vertices[vertex], u = dgfem_body_displacement(body, element, x);
    x.x += u.x, x.y += u.y, x.z += u.z;
    return x;
}

static double von_mises(const dgfem_mat3 *s) {
    double xx = (double)s->m[0][0], yy = (double)s->m[1][1], zz = (double)s->m[2][2];
    double xy = (double)s->m[0][1], yz = (double)s->m[1][2], zx = (double)s->m[2][0];
    return sqrt(((xx - yy) * (xx - yy) + (yy - zz) * (yy - zz) + (zz - xx) * (zz - xx)) / 2 +
                3 * (xy * xy + yz * yz + zx * zx));
}

static int write_frame(const options *o, const scene *s, int frame, double *stress) {
    char path[1024];
    formats_error error;
    formats_cell_data data;
    int vertices = s->skin->vertex_count, elements = s->body->mesh->element_count;
    snprintf(path, sizeof path, "%s/skin_%04d.obj", o->out, frame);
    int ok = formats_write_obj(path, dgfem_points_in_vec3(s->skin->positions, vertices),
                               dgfem_points_in_vec3(s->skin->normals, vertices), s->surface.triangles,
                               s->surface.triangle_count, &error);
    for (int e = 0; e < elements; e++) {
        dgfem_mat3 full = dgfem_body_stress(s->body, e, s->body->mesh->elements[e].centre);
        stress[e] = von_mises(&full);
    }
    data.name = "von_mises", data.components = 1, data.values = stress;
    snprintf(path, sizeof path, "%s/elements_%04d.vtu", o->out, frame);
    if (ok) ok = formats_write_vtu(path, s->body->mesh, deformed, s->body, &data, 1, &error);
    if (!ok) fprintf(stderr, "%s\n", error.text);
    return ok;
}

/* The picture: slope, floor and the skin at several moments, all in one coloured surface. */
enum { MOMENTS = 5 };

typedef struct picture {
    dgfem_vec3 *positions, *normals;
    unsigned char *colors;
    int *triangles;
    int vertex_count, triangle_count;
} picture;

static int make_picture(picture *p, const scene *s) {
    size_t vertices = (size_t)(MOMENTS * s->skin->vertex_count + 8), triangles = (size_t)(MOMENTS * s->skin->triangle_count + 4);
    memset(p, 0, sizeof *p);
    p->positions = (dgfem_vec3 *)malloc(vertices * sizeof *p->positions);
    p->normals = (dgfem_vec3 *)malloc(vertices * sizeof *p->normals);
    p->colors = (unsigned char *)malloc(3 * vertices);
    p->triangles = (int *)malloc(3 * triangles * sizeof *p->triangles);
    return p->positions && p->normals && p->colors && p->triangles;
}

static void destroy_picture(picture *p) {
    free(p->positions);
    free(p->normals);
    free(p->colors);
    free(p->triangles);
}

static void add_vertex(picture *p, dgfem_vec3 position, dgfem_vec3 normal, int red, int green, int blue) {
    unsigned char *color = p->colors + 3 * p->vertex_count;
    color[0] = (unsigned char)red, color[1] = (unsigned char)green, color[2] = (unsigned char)blue;
    p->positions[p->vertex_count] = position;
    p->normals[p->vertex_count++] = normal;
}

static void add_ground(picture *p, double x0, double z0, double x1, double z1) {
    double length = hypot(x1 - x0, z1 - z0);
    dgfem_vec3 normal = {0, 0, 0};
    normal.x = (dgfem_real)((z0 - z1) / length), normal.z = (dgfem_real)((x1 - x0) / length);
    int first = p->vertex_count;
    const int corners[6] = {0, 1, 2, 0, 2, 3};
    for (int k = 0; k < 4; k++) {
        int far = k == 1 || k == 2;
        dgfem_vec3 x = {0, 0, 0};
        x.x = (dgfem_real)(far ? x1 : x0), x.y = k < 2 ? DGFEM_R(-1.2) : DGFEM_R(1.2), x.z = (dgfem_real)(far ? z1 : z0);
        add_vertex(p, x, normal, 200, 205, 210);
    }
    for (int k = 0; k < 6; k++) p->triangles[3 * p->triangle_count + k] = first + corners[k];
    p->triangle_count += 2;
}

static void add_moment(picture *p, const scene *s, double age) {
    int first = p->vertex_count;
    for (int v = 0; v < s->skin->vertex_count; v++)
        add_vertex(p, s->skin->positions[v], s->skin->normals[v], (int)(70 + 170 * age), (int)(140 - 30 * age),
                   (int)(230 - 170 * age));
    for (int k = 0; k < 3 * s->skin->triangle_count; k++)
        p->triangles[3 * p->triangle_count + k] = first + s->skin->triangles[k];
    p->triangle_count += s->skin->triangle_count;
}

static int write_picture(const options *o, picture *p) {
    const double angle = o->slope * 3.14159265358979323846 / 180;
    char path[1024];
    formats_error error;
    add_ground(p, -3.4, 3.4 * tan(angle), 0, 0);
    add_ground(p, 0, 0, 3.5, 0);
    snprintf(path, sizeof path, "%s/scene.ply", o->out);
    if (formats_write_ply(path, dgfem_points_in_vec3(p->positions, p->vertex_count),
                          dgfem_points_in_vec3(p->normals, p->vertex_count), p->colors, p->triangles,
                          p->triangle_count, &error))
        return 1;
    fprintf(stderr, "%s\n", error.text);
    return 0;
}

/* ---- the run ---- */

static double largest_speed(const dgfem_body *body) {
    double largest = 0;
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_vec3 v = dgfem_body_velocity(body, e, body->mesh->elements[e].centre);
        largest = fmax(largest, sqrt((double)(v.x * v.x + v.y * v.y + v.z * v.z)));
    }
    return largest;
}

static int step(const options *o, scene *s, int is_last_second, statistics *st) {
    dgfem_step_info info;
    dgfem_energy energy;
    if (dgfem_body_step(s->body, (dgfem_real)o->dt, &info)) return 0;
    double start = program_seconds();
    if (dgfem_skin_update(s->skin, s->body)) return 0;
    st->skin += program_seconds() - start;
    st->steps++;
    st->assemble += info.seconds_assemble, st->contact += info.seconds_contact;
    st->factor += info.seconds_factor, st->solve += info.seconds_solve;
    st->contacts = info.contacts;
    if (dgfem_body_energy(s->body, &energy)) return 0;
    st->kinetic_last = (double)energy.kinetic;
    st->kinetic_peak = fmax(st->kinetic_peak, st->kinetic_last);
    st->volume_drift = fmax(st->volume_drift, fabs((double)dgfem_body_volume(s->body) / st->volume_start - 1));
    if (is_last_second) st->last_second_speed = fmax(st->last_second_speed, largest_speed(s->body));
    return 1;
}

static int run(const options *o, scene *s, statistics *st) {
    static const double moments[MOMENTS] = {0, 0.065, 0.115, 0.17, 1};
    int steps = (int)(o->seconds / o->dt + 0.5), next_moment = 0, ok = 1;
    program_progress progress;
    picture p;
    double *stress = (double *)malloc((size_t)s->body->mesh->element_count * sizeof *stress);
    memset(st, 0, sizeof *st);
    memset(&progress, 0, sizeof progress);
    st->volume_start = (double)dgfem_mesh_volume(s->body->mesh);
    ok = make_picture(&p, s) && stress && dgfem_skin_update(s->skin, s->body) == DGFEM_OK;
    for (int i = 0; ok && i <= steps; i++) {
        if (i > 0) ok = step(o, s, (steps - i) * o->dt < 1, st);
        if (ok && o->write_frames && i % o->frame_every == 0) ok = write_frame(o, s, st->frames++, stress);
        if (ok && next_moment < MOMENTS && i >= moments[next_moment] * steps)
            add_moment(&p, s, (double)next_moment++ / (MOMENTS - 1));
        program_show_progress(&progress, i, steps, "bunny");
    }
    program_end_progress(&progress);
    if (ok && o->write_frames) ok = write_picture(o, &p);
    free(stress);
    destroy_picture(&p);
    return ok;
}

static void print_summary(const options *o, const scene *s, const statistics *st) {
    double per_step = 1e3 / st->steps;
    printf("model              %s, %d triangles\n", o->model ? o->model : "built in", s->surface.triangle_count);
    printf("slicing            %d elements of %d raw, %.1f ms\n", s->body->mesh->element_count, s->slices.elements_raw,
           s->milliseconds_slice);
    printf("unknowns           %d\n", 3 * s->body->basis_count);
    printf("simulated          %d steps of %g s, %d frames in %s\n", st->steps, o->dt, st->frames, o->out);
    printf("time per step      %.2f ms: assemble %.2f, contact %.2f, factor %.2f, solve %.2f, skin %.2f\n",
           per_step * (st->assemble + st->contact + st->factor + st->solve + st->skin), per_step * st->assemble,
           per_step * st->contact, per_step * st->factor, per_step * st->solve, per_step * st->skin);
    printf("volume             drifts by %.3f %% at most, %.3f %% at the end\n", 100 * st->volume_drift,
           100 * ((double)dgfem_body_volume(s->body) / st->volume_start - 1));
    printf("kinetic energy     peak %.4g J, at the end %.3g J (%.2g of the peak)\n", st->kinetic_peak,
           st->kinetic_last, st->kinetic_last / st->kinetic_peak);
    printf("last second        no element moves faster than %.2g m/s; %d points touch\n", st->last_second_speed,
           st->contacts);
}

int main(int argc, char **argv) {
    options o = read_options(argc, argv);
    scene s;
    statistics st;
    (void)mkdir(o.out, 0777); /* where it cannot be made, writing the first frame says so */
    int ok = make_scene(&o, &s) && run(&o, &s, &st);
    if (ok) print_summary(&o, &s, &st);
    destroy_scene(&s);
    return ok ? 0 : 1;
}
