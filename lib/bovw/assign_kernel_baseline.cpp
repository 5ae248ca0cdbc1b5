#define WEFT_KERNEL kAssignBaseline
#include "bovw/assign_kernel.inc"
