# After project(): packages are looked for among those of this machine.
execute_process(COMMAND gcc -print-multiarch OUTPUT_VARIABLE CMAKE_LIBRARY_ARCHITECTURE OUTPUT_STRIP_TRAILING_WHITESPACE)
set(ENV{PKG_CONFIG_PATH} /usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/pkgconfig)
