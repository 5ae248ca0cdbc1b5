#define WEFT_KERNEL kNormalsAvx2
#include "rgbd/normals_kernel.inc"
