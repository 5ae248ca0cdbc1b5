#define WEFT_KERNEL kSiftBaseline
#include "descriptor/sift_kernel.inc"
