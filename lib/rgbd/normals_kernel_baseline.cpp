#define WEFT_KERNEL kNormalsBaseline
#include "rgbd/normals_kernel.inc"
