/* File formats of the examples: triangle surfaces in (OBJ, PLY, STL, OFF), tetrahedral meshes in (TetGen, Gmsh),
   surfaces and element meshes out (OBJ, PLY, VTU). Not part of the library; take what you need.

   Every function returns 1 on success; on failure 0, with one line in error->text that names the file and, where it
   can, the line, byte or face. Readers take any bytes: they check every count and index, and allocate only what the
   file's own size accounts for. They do not judge the geometry: that is the library's. */
#ifndef FORMATS_H
#define FORMATS_H

#include "dgfem.h"

typedef struct formats_error {
    char text[512];
} formats_error;

#if defined(__GNUC__) || defined(__clang__)
#define FORMATS_PRINTF(format_index, first) __attribute__((format(printf, format_index, first)))
#else
#define FORMATS_PRINTF(format_index, first)
#endif

/* Fills in the error, "path: ...", and returns 0. */
FORMATS_PRINTF(3, 4)
int formats_fail(formats_error *error, const char *path, const char *format, ...);

/* ---- reading ---- */

typedef struct formats_surface {
    double *vertices; /* [3 * vertex_count] finite */
    int *triangles;   /* [3 * triangle_count] 0 <= index < vertex_count */
    int vertex_count, triangle_count;
} formats_surface;

/* The format is told by the file's first bytes, or else by the ending of its name. Polygons become fans of triangles;
   STL's equal vertices become one. On failure *out is empty. */
int formats_read_surface(const char *path, formats_surface *out, formats_error *error);
void formats_free_surface(formats_surface *surface);

typedef struct formats_tetrahedra {
    double *vertices; /* [3 * vertex_count] finite */
    int *tetrahedra;  /* [4 * tetrahedron_count] 0 <= index < vertex_count; positively oriented where it has a volume */
    int vertex_count, tetrahedron_count;
} formats_tetrahedra;

/* The ending of the path tells the format. TetGen: either of the files name.node and name.ele, numbered from 0 or 1 or
   anyhow, 4 or 10 nodes per element. Gmsh: name.msh, ASCII, version 2.2 or 4.1; points, lines and surfaces are skipped,
   other solids than tetrahedra refused. Elements of higher order are taken by their corners. Vertices keep the order of
   the file; those that no tetrahedron has are left out. On failure *out is empty. */
int formats_read_tetrahedra(const char *path, formats_tetrahedra *out, formats_error *error);
void formats_free_tetrahedra(formats_tetrahedra *tetrahedra);

/* Their mesh, by dgfem_mesh_create_tetrahedra, which logs what it refuses. hooks may be NULL. */
dgfem_status formats_tetrahedra_mesh(const formats_tetrahedra *tetrahedra, const dgfem_hooks *hooks, dgfem_mesh **out);

/* The boundary of a mesh at rest, triangulated; vertices are shared as in the mesh. *faces (may be NULL) becomes the
   mesh face of each triangle, to be freed. */
int formats_mesh_boundary(const dgfem_mesh *mesh, formats_surface *out, int **faces, formats_error *error);

/* ---- writing ---- */

/* Wavefront OBJ. normals.count is 0 (none) or positions.count. */
int formats_write_obj(const char *path, dgfem_points_in positions, dgfem_points_in normals, const int *triangles,
                      int triangle_count, formats_error *error);

/* Binary PLY. normals.count is 0 or positions.count; colors are red, green, blue for each position, or NULL. */
int formats_write_ply(const char *path, dgfem_points_in positions, dgfem_points_in normals, const unsigned char *colors,
                      const int *triangles, int triangle_count, formats_error *error);

/* Where a vertex of an element is now. */
typedef dgfem_vec3 (*formats_position_fn)(void *user, int element, int vertex);

/* One array of numbers per element. */
typedef struct formats_cell_data {
    const char *name;
    int components;       /* 1, 3 or 9 (row by row) */
    const double *values; /* [element_count * components] */
} formats_cell_data;

/* The mesh as VTK XML unstructured grid of polyhedra. Each element has its own points, so that jumps between elements
   show. `position` may be NULL: the rest position; otherwise the points' displacement is written as well. Faces of
   several loops are triangulated. */
int formats_write_vtu(const char *path, const dgfem_mesh *mesh, formats_position_fn position, void *user,
                      const formats_cell_data *data, int data_count, formats_error *error);

#endif
