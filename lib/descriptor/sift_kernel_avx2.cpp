#define WEFT_KERNEL kSiftAvx2
#include "descriptor/sift_kernel.inc"
