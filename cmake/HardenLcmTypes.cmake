# cmake -D DIR=<folder of generated headers> -P HardenLcmTypes.cmake
# lcm-gen's decoders size vectors and strings by counts they read from the message: a few hostile bytes ask for
# gigabytes. Every element takes at least one byte, so a count beyond the bytes that are left is refused.
file(GLOB HEADERS ${DIR}/*.hpp)
foreach(HEADER ${HEADERS})
  file(READ ${HEADER} TEXT)
  string(REGEX REPLACE "(this->[a-z0-9_]+(\\[[a-z0-9]+\\])*\\.resize\\((this->[a-z0-9_]+)\\);)"
         "if (\\3 < 0 || \\3 > maxlen - pos) return -1; \\1" HARDENED "${TEXT}")
  string(REGEX REPLACE "if\\((__[a-z0-9_]+_len__) > maxlen - pos\\)"
         "if (\\1 < 1 || \\1 > maxlen - pos)" HARDENED "${HARDENED}")
  string(REGEX MATCHALL "\\.resize\\(|_len__ > maxlen" SIZED "${HARDENED}")
  string(REGEX MATCHALL "> maxlen - pos\\)" CHECKED "${HARDENED}")
  list(LENGTH SIZED SIZED)
  list(LENGTH CHECKED CHECKED)
  if(NOT SIZED EQUAL CHECKED)
    message(FATAL_ERROR "${HEADER}: ${SIZED} places are sized by the message but ${CHECKED} are checked; "
                        "has lcm-gen's output changed?")
  endif()
  file(WRITE ${HEADER} "${HARDENED}")
endforeach()
