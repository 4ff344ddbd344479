# Installs palpate into a scratch folder, builds the program beside this file against it and runs it.
file(REMOVE_RECURSE ${SCRATCH})
foreach(command IN ITEMS "--install;${BUILD};--prefix;${SCRATCH}/prefix"
        "-S;${SOURCE};-B;${SCRATCH}/build;-G;${GENERATOR};-DCMAKE_PREFIX_PATH=${SCRATCH}/prefix" "--build;${SCRATCH}/build")
    execute_process(COMMAND ${CMAKE_COMMAND} ${command} RESULT_VARIABLE failed OUTPUT_VARIABLE output ERROR_VARIABLE output)
    if(failed)
        message(FATAL_ERROR "cmake ${command} failed:\n${output}")
    endif()
endforeach()
execute_process(COMMAND ${SCRATCH}/build/consumer RESULT_VARIABLE failed)
if(failed)
    message(FATAL_ERROR "the embedding program failed: ${failed}")
endif()
