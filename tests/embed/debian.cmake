# Makes the Debian packages, unpacks the program's, and runs a scene by its bare name from an empty folder with what the
# package brings; the libraries that it needs must be those that it names.
include(${CMAKE_CURRENT_LIST_DIR}/try.cmake)
file(REMOVE_RECURSE ${SCRATCH})
file(MAKE_DIRECTORY ${SCRATCH}/empty)
try("packing" ${CMAKE_COMMAND} -E chdir ${BUILD} cpack -G DEB -B ${SCRATCH})
file(GLOB package ${SCRATCH}/palpate_*.deb)
try("reading" dpkg-deb --field ${package} Depends)
foreach(library libnlopt0 libusb-1.0-0 libtbb12 libstdc\\+\\+6 libc6)
    if(NOT output MATCHES "${library}")
        message(FATAL_ERROR "the package does not depend on ${library}: ${output}")
    endif()
endforeach()
try("unpacking" dpkg-deb -x ${package} ${SCRATCH}/root)
try("running a scene" ${CMAKE_COMMAND} -E chdir ${SCRATCH}/empty ${SCRATCH}/root/usr/bin/palpate run press --duration 0.05
    --quiet)
if(NOT EXISTS ${SCRATCH}/empty/results/press/summary.json)
    message(FATAL_ERROR "palpate run press left no results")
endif()
