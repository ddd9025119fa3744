/* Writers of surfaces and element meshes. */
#include "formats.h"

#include <errno.h>
#include <limits.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int push_int(int **data, int *count, int *capacity, int value) {
    if (*count == *capacity) {
        int wanted = *capacity ? *capacity > INT_MAX / 2 ? INT_MAX : 2 * *capacity : 1024;
        int *grown = wanted > *capacity ? (int *)realloc(*data, (size_t)wanted * sizeof(int)) : NULL;
        if (!grown) return 0;
        *data = grown;
        *capacity = wanted;
    }
    (*data)[(*count)++] = value;
    return 1;
}

/* ---- writing ---- */

static FILE *output_open(const char *path, formats_error *error) {
    FILE *file = fopen(path, "wb");
    if (!file) formats_fail(error, path, "cannot be written: %s", strerror(errno));
    return file;
}

static int output_close(FILE *file, const char *path, formats_error *error) {
    int bad = ferror(file);
    if (fclose(file) != 0) bad = 1;
    return bad ? formats_fail(error, path, "cannot be written: %s", strerror(errno)) : 1;
}

static void point_at(const dgfem_points_in *points, int i, double xyz[3]) {
    int is_float = points->type == DGFEM_FLOAT32, k;
    size_t number = is_float ? sizeof(float) : sizeof(double);
    size_t stride = points->stride ? (size_t)points->stride : 3 * number;
    const char *data = (const char *)points->data + stride * (size_t)i;
    for (k = 0; k < 3; k++, data += number) {
        float single;
        if (is_float) memcpy(&single, data, sizeof single), xyz[k] = (double)single;
        else memcpy(&xyz[k], data, sizeof xyz[k]);
    }
}

int formats_write_obj(const char *path, dgfem_points_in positions, dgfem_points_in normals, const int *triangles,
                      int triangle_count, formats_error *error) {
    FILE *file = output_open(path, error);
    int i, k, digits = positions.type == DGFEM_FLOAT32 ? 9 : 17; /* enough to read the same number back */
    double v[3];
    if (!file) return 0;
    for (i = 0; i < positions.count; i++) {
        point_at(&positions, i, v);
        fprintf(file, "v %.*g %.*g %.*g\n", digits, v[0], digits, v[1], digits, v[2]);
    }
    for (i = 0; i < normals.count; i++) {
        point_at(&normals, i, v);
        fprintf(file, "vn %.5g %.5g %.5g\n", v[0], v[1], v[2]);
    }
    for (i = 0; i < triangle_count; i++) {
        fputc('f', file);
        for (k = 0; k < 3; k++) {
            int corner = triangles[3 * (size_t)i + (size_t)k] + 1;
            if (normals.count) fprintf(file, " %d//%d", corner, corner);
            else fprintf(file, " %d", corner);
        }
        fputc('\n', file);
    }
    return output_close(file, path, error);
}

static void put_little_endian32(FILE *file, uint32_t bits) {
    int i;
    for (i = 0; i < 4; i++) fputc((int)(bits >> (8 * i) & 255), file);
}

static void put_float3(FILE *file, const double v[3]) {
    int k;
    for (k = 0; k < 3; k++) {
        float single = (float)v[k];
        uint32_t bits;
        memcpy(&bits, &single, sizeof bits);
        put_little_endian32(file, bits);
    }
}

int formats_write_ply(const char *path, dgfem_points_in positions, dgfem_points_in normals, const unsigned char *colors,
                      const int *triangles, int triangle_count, formats_error *error) {
    FILE *file = output_open(path, error);
    double v[3];
    int i, k;
    if (!file) return 0;
    fprintf(file, "ply\nformat binary_little_endian 1.0\nelement vertex %d\n", positions.count);
    fputs("property float x\nproperty float y\nproperty float z\n", file);
    if (normals.count) fputs("property float nx\nproperty float ny\nproperty float nz\n", file);
    if (colors) fputs("property uchar red\nproperty uchar green\nproperty uchar blue\n", file);
    fprintf(file, "element face %d\nproperty list uchar int vertex_indices\nend_header\n", triangle_count);
    for (i = 0; i < positions.count; i++) {
        point_at(&positions, i, v);
        put_float3(file, v);
        if (normals.count) {
            point_at(&normals, i, v);
            put_float3(file, v);
        }
        if (colors) fwrite(colors + 3 * (size_t)i, 1, 3, file);
    }
    for (i = 0; i < triangle_count; i++) {
        fputc(3, file);
        for (k = 0; k < 3; k++) put_little_endian32(file, (uint32_t)triangles[3 * (size_t)i + (size_t)k]);
    }
    return output_close(file, path, error);
}

/* ---- triangles of a mesh's faces ---- */

/* Scratch that grows to the largest face. */
typedef struct face_triangles {
    int *triangles; /* [3 * count] mesh vertices, counter-clockwise seen from the tip of the face's normal */
    int count;
    int *corners, *mesh_vertex; /* [capacity] */
    dgfem_vec3 *vertices;       /* [capacity] */
    int *loop_start;            /* [capacity + 1] */
    int capacity;               /* in corners; a face of n corners has fewer than 3 n triangles */
} face_triangles;

static void face_triangles_free(face_triangles *f) {
    free(f->triangles), free(f->corners), free(f->mesh_vertex), free(f->vertices), free(f->loop_start);
}

static int face_triangles_reserve(face_triangles *f, int corners) {
    size_t n = 2 * (size_t)corners;
    if (corners <= f->capacity) return 1;
    face_triangles_free(f);
    f->triangles = (int *)malloc(9 * n * sizeof(int));
    f->corners = (int *)malloc(n * sizeof(int));
    f->mesh_vertex = (int *)malloc(n * sizeof(int));
    f->vertices = (dgfem_vec3 *)malloc(n * sizeof(dgfem_vec3));
    f->loop_start = (int *)malloc((n + 1) * sizeof(int));
    f->capacity = f->triangles && f->corners && f->mesh_vertex && f->vertices && f->loop_start ? (int)n : 0;
    return f->capacity > 0;
}

static int face_triangulate(face_triangles *f, const dgfem_mesh *mesh, const dgfem_face *face) {
    const dgfem_loop *loops = mesh->loops + face->loop_start;
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfem_polyhedron *polygon = NULL;
    int face_loops[2], total = 0, n = 0, ok, i, k;
    for (i = 0; i < face->loop_count; i++) total += loops[i].count;
    if (!face_triangles_reserve(f, total)) return 0;
    for (i = 0; i < face->loop_count; i++) {
        f->loop_start[i] = n;
        for (k = 0; k < loops[i].count; k++, n++) {
            f->corners[n] = n;
            f->mesh_vertex[n] = mesh->loop_vertices[loops[i].start + k];
            f->vertices[n] = mesh->vertices[f->mesh_vertex[n]];
        }
    }
    f->loop_start[face->loop_count] = n;
    face_loops[0] = 0, face_loops[1] = face->loop_count;
    desc.vertices = f->vertices, desc.vertex_count = n, desc.face_count = 1;
    desc.face_loops = face_loops, desc.loop_start = f->loop_start, desc.loop_vertices = f->corners;
    if (dgfem_polyhedron_create(&desc, &polygon) != DGFEM_OK) return 0;
    ok = dgfem_polyhedron_triangulate_face(polygon, 0, f->triangles, 3 * f->capacity, &f->count) == DGFEM_OK;
    dgfem_polyhedron_destroy(polygon);
    for (i = 0; ok && i < 3 * f->count; i++) f->triangles[i] = f->mesh_vertex[f->triangles[i]];
    return ok;
}

/* ---- boundary ---- */

/* The vertices that the triangles use, renumbered by first use. */
static int boundary_compact(const dgfem_mesh *mesh, formats_surface *surface) {
    int *number = (int *)malloc(((size_t)mesh->vertex_count + 1) * sizeof(int)), i;
    double *next;
    next = surface->vertices = (double *)malloc(3 * (size_t)mesh->vertex_count * sizeof(double));
    if (!number || !next) {
        free(number);
        return 0;
    }
    for (i = 0; i < mesh->vertex_count; i++) number[i] = -1;
    for (i = 0; i < 3 * surface->triangle_count; i++) {
        int vertex = surface->triangles[i];
        if (number[vertex] < 0) {
            dgfem_vec3 p = mesh->vertices[vertex];
            number[vertex] = surface->vertex_count++;
            *next++ = (double)p.x, *next++ = (double)p.y, *next++ = (double)p.z;
        }
        surface->triangles[i] = number[vertex];
    }
    free(number);
    return 1;
}

int formats_mesh_boundary(const dgfem_mesh *mesh, formats_surface *out, int **faces, formats_error *error) {
    face_triangles scratch;
    int *sources = NULL, source_count = 0, source_capacity = 0, corner_count = 0, corner_capacity = 0, ok = 1, f, i;
    memset(&scratch, 0, sizeof scratch);
    memset(out, 0, sizeof *out);
    for (f = 0; ok && f < mesh->face_count; f++) {
        if (mesh->faces[f].element[1] != DGFEM_NONE) continue;
        ok = face_triangulate(&scratch, mesh, &mesh->faces[f]);
        for (i = 0; ok && i < 3 * scratch.count; i++)
            ok = push_int(&out->triangles, &corner_count, &corner_capacity, scratch.triangles[i]);
        for (i = 0; ok && i < scratch.count; i++) ok = push_int(&sources, &source_count, &source_capacity, f);
    }
    face_triangles_free(&scratch);
    out->triangle_count = corner_count / 3;
    ok = ok && boundary_compact(mesh, out);
    if (ok && faces) *faces = sources;
    else free(sources);
    if (ok) return 1;
    formats_free_surface(out);
    return formats_fail(error, "boundary", "out of memory, or a face that cannot be triangulated");
}

/* ---- VTU ---- */

/* The mesh in VTK's arrays. Faces of an element: number of faces, then for each its number of points and the points. */
typedef struct vtu {
    const dgfem_mesh *mesh;
    int *points;      /* mesh vertex of each point; an element's stand together */
    int *point_start; /* [element_count + 1] */
    int *faces;
    int *face_end; /* [element_count] */
    int *local;    /* [vertex_count] point of a mesh vertex in the current element, where marked */
    int *mark;     /* [vertex_count] 1 + the element that last used it */
    int point_count, point_capacity, face_size, face_capacity;
    face_triangles scratch;
} vtu;

static void vtu_free(vtu *v) {
    free(v->points), free(v->point_start), free(v->faces), free(v->face_end), free(v->local), free(v->mark);
    face_triangles_free(&v->scratch);
}

static int vtu_push(vtu *v, int value) { return push_int(&v->faces, &v->face_size, &v->face_capacity, value); }

/* The point of a mesh vertex in an element, made at first use. */
static int vtu_push_corner(vtu *v, int element, int vertex) {
    if (v->mark[vertex] != element + 1) {
        v->mark[vertex] = element + 1;
        v->local[vertex] = v->point_count;
        if (!push_int(&v->points, &v->point_count, &v->point_capacity, vertex)) return 0;
    }
    return vtu_push(v, v->local[vertex]);
}

static int vtu_push_polygon(vtu *v, int element, const int *vertices, int count, int reversed) {
    int k;
    if (!vtu_push(v, count)) return 0;
    for (k = 0; k < count; k++)
        if (!vtu_push_corner(v, element, vertices[reversed ? count - 1 - k : k])) return 0;
    return 1;
}

/* Appends one face of an element, seen from outside; the number of polygons it became, or 0 on failure. VTK knows no
   faces with holes: they become triangles. */
static int vtu_push_face(vtu *v, int element, const dgfem_face *face) {
    int reversed = face->element[0] != element, i;
    if (face->loop_count == 1) {
        dgfem_loop loop = v->mesh->loops[face->loop_start];
        return vtu_push_polygon(v, element, v->mesh->loop_vertices + loop.start, loop.count, reversed);
    }
    if (!face_triangulate(&v->scratch, v->mesh, face)) return 0;
    for (i = 0; i < v->scratch.count; i++)
        if (!vtu_push_polygon(v, element, v->scratch.triangles + 3 * i, 3, reversed)) return 0;
    return v->scratch.count;
}

static int vtu_build(vtu *v) {
    const dgfem_mesh *mesh = v->mesh;
    size_t elements = (size_t)mesh->element_count, vertices = (size_t)mesh->vertex_count;
    int e, k;
    v->point_start = (int *)calloc(elements + 1, sizeof(int));
    v->face_end = (int *)calloc(elements + 1, sizeof(int));
    v->local = (int *)calloc(vertices + 1, sizeof(int));
    v->mark = (int *)calloc(vertices + 1, sizeof(int));
    if (!v->point_start || !v->face_end || !v->local || !v->mark) return 0;
    for (e = 0; e < mesh->element_count; e++) {
        const dgfem_element *element = &mesh->elements[e];
        int head = v->face_size, polygons = 0;
        if (!vtu_push(v, 0)) return 0;
        for (k = 0; k < element->face_count; k++) {
            int made = vtu_push_face(v, e, &mesh->faces[mesh->element_faces[element->face_start + k]]);
            if (!made) return 0;
            polygons += made;
        }
        v->faces[head] = polygons;
        v->face_end[e] = v->face_size;
        v->point_start[e + 1] = v->point_count;
    }
    return 1;
}

/* At rest with all digits, so that what is closed and exact stays so; moved ones with enough to look at. */
static void vtu_put_points(FILE *file, const vtu *v, formats_position_fn position, void *user, int displacement) {
    int e, i, digits = displacement ? 6 : position ? 9 : 17;
    for (e = 0; e < v->mesh->element_count; e++)
        for (i = v->point_start[e]; i < v->point_start[e + 1]; i++) {
            dgfem_vec3 p = v->mesh->vertices[v->points[i]];
            if (position) {
                dgfem_vec3 now = position(user, e, v->points[i]);
                if (displacement) now.x -= p.x, now.y -= p.y, now.z -= p.z;
                p = now;
            }
            fprintf(file, "%.*g %.*g %.*g\n", digits, (double)p.x, digits, (double)p.y, digits, (double)p.z);
        }
}

static void vtu_put_ints(FILE *file, const char *type, const char *name, const int *values, int count) {
    int i;
    fprintf(file, "<DataArray type=\"%s\" Name=\"%s\" format=\"ascii\">\n", type, name);
    for (i = 0; i < count; i++) fprintf(file, i % 16 == 15 || i + 1 == count ? "%d\n" : "%d ", values[i]);
    fputs("</DataArray>\n", file);
}

/* A name in quotes. */
static void vtu_put_name(FILE *file, const char *name) {
    for (; *name; name++) {
        if (strchr("<>&\"", *name)) fprintf(file, "&#%d;", *name);
        else fputc(*name, file);
    }
}

static void vtu_put_cells(FILE *file, const vtu *v) {
    int e, i, count = v->mesh->element_count;
    fputs("<Cells>\n<DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">\n", file);
    for (i = 0; i < v->point_count; i++) fprintf(file, i % 16 == 15 || i + 1 == v->point_count ? "%d\n" : "%d ", i);
    fputs("</DataArray>\n", file);
    vtu_put_ints(file, "Int32", "offsets", v->point_start + 1, count);
    fputs("<DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">\n", file);
    for (e = 0; e < count; e++) fputs("42\n", file); /* VTK_POLYHEDRON */
    fputs("</DataArray>\n", file);
    vtu_put_ints(file, "Int32", "faces", v->faces, v->face_size);
    vtu_put_ints(file, "Int32", "faceoffsets", v->face_end, count);
    fputs("</Cells>\n", file);
}

static void vtu_put_cell_data(FILE *file, const vtu *v, const formats_cell_data *data, int data_count) {
    int i, e, k;
    fputs("<CellData>\n", file);
    for (i = 0; i < data_count; i++) {
        int n = data[i].components;
        fputs("<DataArray type=\"Float64\" Name=\"", file);
        vtu_put_name(file, data[i].name);
        fprintf(file, "\" NumberOfComponents=\"%d\" format=\"ascii\">\n", n);
        for (e = 0; e < v->mesh->element_count; e++)
            for (k = 0; k < n; k++)
                fprintf(file, k + 1 == n ? "%.9g\n" : "%.9g ", data[i].values[(size_t)e * (size_t)n + (size_t)k]);
        fputs("</DataArray>\n", file);
    }
    fputs("</CellData>\n", file);
}

int formats_write_vtu(const char *path, const dgfem_mesh *mesh, formats_position_fn position, void *user,
                      const formats_cell_data *data, int data_count, formats_error *error) {
    vtu v;
    FILE *file;
    memset(&v, 0, sizeof v);
    v.mesh = mesh;
    if (!vtu_build(&v)) {
        vtu_free(&v);
        return formats_fail(error, path, "out of memory, or a face that cannot be triangulated");
    }
    file = output_open(path, error);
    if (!file) {
        vtu_free(&v);
        return 0;
    }
    fputs("<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">\n",
          file);
    fprintf(file, "<UnstructuredGrid>\n<Piece NumberOfPoints=\"%d\" NumberOfCells=\"%d\">\n", v.point_count,
            mesh->element_count);
    fputs("<Points>\n<DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">\n", file);
    vtu_put_points(file, &v, position, user, 0);
    fputs("</DataArray>\n</Points>\n<PointData>\n", file);
    if (position) {
        fputs("<DataArray type=\"Float64\" Name=\"displacement\" NumberOfComponents=\"3\" format=\"ascii\">\n", file);
        vtu_put_points(file, &v, position, user, 1);
        fputs("</DataArray>\n", file);
    }
    fputs("</PointData>\n", file);
    vtu_put_cell_data(file, &v, data, data_count);
    vtu_put_cells(file, &v);
    fputs("</Piece>\n</UnstructuredGrid>\n</VTKFile>\n", file);
    vtu_free(&v);
    return output_close(file, path, error);
}
