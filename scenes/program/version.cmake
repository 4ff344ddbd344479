# Writes the source that knows version and commit, but only where they have changed.
execute_process(COMMAND git rev-parse --short HEAD WORKING_DIRECTORY ${ROOT} OUTPUT_VARIABLE COMMIT
                OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE no_git)
if(no_git)
    set(COMMIT "")
endif()
configure_file(${TEMPLATE} ${OUTPUT} @ONLY)
