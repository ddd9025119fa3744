/* A soft bunny, sliced into polyhedra by a grid, tumbles down a slope and comes to rest.

   Writes into the folder --out: skin_NNNN.obj (the smooth skin) and elements_NNNN.vtu (the polyhedra with their stress)
   for every frame, and scene.ply (the slope and the skin at several moments in one picture). */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include <sys/stat.h>

#include "formats.h"
#include "model.h"
#include "picture.h"
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
    int steps, frames, contacts, iterations, factorizations;
    double assemble, contact, factor, solve, skin; /* seconds */
    double volume_start, volume_drift;             /* largest relative change */
    double kinetic_peak, kinetic_last, last_second_speed;
} statistics;

static options read_options(int argc, char **argv) {
    program p = program_begin(argc, argv,
                              "bunny [--model FILE] [--out build/demo] [--cells 11] [--seconds 12] [--dt 0.0166667]\n"
                              "  [--young 4e5] [--slope 30] [--frame-every 3] [--no-frames]\n"
                              "  [--solver auto|stale|cholesky|sweeps|pcg]");
    options o;
    o.model = program_text(&p, "--model", NULL);
    o.out = program_text(&p, "--out", "build/demo");
    o.cells = program_int(&p, "--cells", 11, 1, 1000);
    o.seconds = program_real(&p, "--seconds", 12);
    o.dt = program_real(&p, "--dt", 1.0 / 60);
    o.young = program_real(&p, "--young", 4e5);
    o.slope = program_real(&p, "--slope", 30);
    o.solver = (dgfem_solver)program_choice(&p, "--solver", "auto|stale|cholesky|sweeps|pcg", 0);
    o.frame_every = program_int(&p, "--frame-every", 3, 1, 1000000);
    o.write_frames = !program_flag(&p, "--no-frames");
    program_end(&p);
    return o;
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

/* The skin's vertices are what touches. */
static int make_contact_points(scene *s) {
    dgfem_real *areas = (dgfem_real *)calloc((size_t)s->surface.vertex_count, sizeof *areas);
    if (!areas) return 0;
    model_vertex_areas(&s->surface, areas);
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
    return model_read(o->model, &s->surface) && make_body(o, s) && make_skin(s) && make_contact_points(s) &&
           place(o, s);
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

static void add_ground(picture *p, double x0, double z0, double x1, double z1) {
    dgfem_vec3 a = {0, 0, 0}, along = {0, 0, 0}, across = {0, 0, 0};
    a.x = (dgfem_real)x0, a.y = DGFEM_R(-1.2), a.z = (dgfem_real)z0;
    along.x = (dgfem_real)(x1 - x0), along.z = (dgfem_real)(z1 - z0), across.y = DGFEM_R(2.4);
    picture_add_parallelogram(p, a, along, across, picture_rgb(200, 205, 210));
}

static void add_moment(picture *p, const scene *s, double age) {
    picture_color color = picture_rgb((int)(70 + 170 * age), (int)(140 - 30 * age), (int)(230 - 170 * age));
    picture_add_skin(p, s->skin, color, color);
}

static int write_picture(const options *o, picture *p) {
    const double angle = o->slope * 3.14159265358979323846 / 180;
    char path[1024];
    add_ground(p, -3.4, 3.4 * tan(angle), 0, 0);
    add_ground(p, 0, 0, 3.5, 0);
    snprintf(path, sizeof path, "%s/scene.ply", o->out);
    return picture_write(p, path);
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
    st->iterations += info.iterations, st->factorizations += info.factorizations;
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
    memset(&p, 0, sizeof p);
    ok = stress && dgfem_skin_update(s->skin, s->body) == DGFEM_OK;
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
    picture_free(&p);
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
    printf("solver             %.1f iterations per step, %d factorizations\n", st->iterations / (double)st->steps,
           st->factorizations);
    printf("volume             drifts by %.3f %% at most, %.3f %% at the end\n", 100 * st->volume_drift,
           100 * ((double)dgfem_body_volume(s->body) / st->volume_start - 1));
    printf("kinetic energy     peak %.4g J, at the end %.3g J (%.2g of the peak)\n", st->kinetic_peak, st->kinetic_last,
           st->kinetic_last / st->kinetic_peak);
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
