/* dgfem_shell.h - thin shells by discontinuous Galerkin finite elements */

/* @contents */

#include "dgfem.h"

#ifndef DGFEM_SHELL_H
#define DGFEM_SHELL_H
#include "shell/api.h"
#endif /* DGFEM_SHELL_H */

#if defined(DGFEM_IMPLEMENTATION) && !defined(DGFEM_SHELL_IMPLEMENTED)
#define DGFEM_SHELL_IMPLEMENTED
#include "shell/base.c"
#include "shell/shape.c"
#include "shell/mesh.c"
#include "shell/element.c"
#include "shell/edge.c"
#include "shell/corotation.c"
#include "shell/system.c"
#include "shell/conditions.c"
#include "shell/load.c"
#include "shell/static.c"
#include "shell/step.c"
#include "shell/query.c"
#include "shell/cut.c"
#include "shell/split.c"
#include "shell/surface.c"
#endif /* DGFEM_IMPLEMENTATION */
