#define WEFT_KERNEL kFpfhBaseline
#include "descriptor/fpfh_kernel.inc"
