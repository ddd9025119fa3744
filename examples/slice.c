/* Slices a closed triangle surface with a grid of cubes and prints what came out, one `key value` pair per line. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "formats.h"
#include "program.h"

typedef struct options {
    const char *model, *obj, *vtu;
    int cells;
    double sliver;
} options;

static options read_options(int argc, char **argv) {
    program p = program_begin(argc, argv, "slice MODEL [--cells 10] [--sliver 1e-3] [--obj FILE] [--vtu FILE]");
    options o;
    o.cells = program_int(&p, "--cells", 10, 1, 100000);
    o.sliver = program_real(&p, "--sliver", 1e-3);
    o.obj = program_text(&p, "--obj", NULL);
    o.vtu = program_text(&p, "--vtu", NULL);
    o.model = program_argument(&p);
    if (!o.model) program_complain(&p, "MODEL", "is missing");
    program_end(&p);
    return o;
}

/* The library's log line, kept to be printed behind the name of the file. */
static void keep_line(void *user, dgfem_log_level level, const char *text) {
    char *line = (char *)user;
    (void)level;
    snprintf(line, 512, "%s", text);
}

static dgfem_mesh *slice(const options *o, const formats_surface *surface, dgfem_slice_info *info, double *seconds) {
    dgfem_slice_desc desc = dgfem_default_slice_desc();
    dgfem_mesh *mesh = NULL;
    char line[512] = "";
    desc.vertices = dgfem_points_in_double(surface->vertices, surface->vertex_count);
    desc.triangles = surface->triangles;
    desc.triangle_count = surface->triangle_count;
    desc.cells = o->cells;
    desc.sliver = (dgfem_real)o->sliver;
    desc.info = info;
    desc.hooks = program_hooks();
    desc.hooks.log = keep_line;
    desc.hooks.log_user = line;
    double start = program_seconds();
    dgfem_status status = dgfem_mesh_create_slices(&desc, &mesh);
    *seconds = program_seconds() - start;
    if (!status) return mesh;
    fprintf(stderr, "%s: %s\n", o->model, line[0] ? line : dgfem_status_text(status));
    return NULL;
}

static void print_figures(const dgfem_mesh *mesh, const dgfem_slice_info *info, double seconds) {
    int interior = 0;
    for (int f = 0; f < mesh->face_count; f++) interior += mesh->faces[f].element[1] != DGFEM_NONE;
    printf("triangles %d\nelements %d\n", info->triangles, mesh->element_count);
    printf("faces_interior %d\nfaces_boundary %d\n", interior, mesh->face_count - interior);
    printf("surface_volume %.17g\nmesh_volume %.17g\n", (double)info->surface_volume, (double)dgfem_mesh_volume(mesh));
    printf("surface_area %.17g\nmesh_area %.17g\n", (double)info->surface_area, (double)dgfem_mesh_boundary_area(mesh));
    printf("slivers_merged %d\nmilliseconds %.3f\n", info->slivers_merged, 1e3 * seconds);
}

static int write_obj(const char *path, const dgfem_mesh *mesh, formats_error *error) {
    formats_surface boundary;
    if (!formats_mesh_boundary(mesh, &boundary, NULL, error)) return 0;
    int ok = formats_write_obj(path, dgfem_points_in_double(boundary.vertices, boundary.vertex_count),
                               dgfem_points_in_double(NULL, 0), boundary.triangles, boundary.triangle_count, error);
    formats_free_surface(&boundary);
    return ok;
}

static int write_files(const options *o, const dgfem_mesh *mesh) {
    formats_error error;
    if (o->obj && !write_obj(o->obj, mesh, &error)) return fprintf(stderr, "%s\n", error.text), 0;
    if (o->vtu && !formats_write_vtu(o->vtu, mesh, NULL, NULL, NULL, 0, &error))
        return fprintf(stderr, "%s\n", error.text), 0;
    return 1;
}

int main(int argc, char **argv) {
    options o = read_options(argc, argv);
    formats_surface surface;
    formats_error error;
    dgfem_slice_info info;
    double seconds;
    if (!formats_read_surface(o.model, &surface, &error)) {
        fprintf(stderr, "%s\n", error.text);
        return 1;
    }
    dgfem_mesh *mesh = slice(&o, &surface, &info, &seconds);
    formats_free_surface(&surface);
    if (!mesh) return 1;
    print_figures(mesh, &info, seconds);
    int ok = write_files(&o, mesh);
    dgfem_mesh_destroy(mesh);
    return ok ? 0 : 1;
}
