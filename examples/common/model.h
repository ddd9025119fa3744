/* The shape that the examples use: a file's, or where there is none a shape made here. */
#ifndef MODEL_H
#define MODEL_H

#include "formats.h"

/* From y up to z up, one metre tall, standing on the origin. `path` may be NULL. 0 and a line on stderr on failure. */
int model_read(const char *path, formats_surface *out);

/* A sphere with five bumps around its waist and two horns, y up. 0 when out of memory. */
int model_make(formats_surface *out);

/* areas[vertex_count]: a third of the triangles around each vertex. */
void model_vertex_areas(const formats_surface *surface, dgfem_real *areas);

#endif
