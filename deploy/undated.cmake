# CPack runs this after it has made a package. CPack 3.25 writes the present time into the headers of the archive whose members are
# dated already; packing them once more without dates makes two packages of one commit equal byte for byte.
foreach(package IN LISTS CPACK_PACKAGE_FILES)
  get_filename_component(folder ${package} DIRECTORY)
  set(members ${folder}/members)
  file(MAKE_DIRECTORY ${members})
  execute_process(COMMAND ar t ${package} WORKING_DIRECTORY ${members} OUTPUT_VARIABLE names COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCHALL "[^\n]+" names "${names}")
  execute_process(COMMAND ar x ${package} WORKING_DIRECTORY ${members} COMMAND_ERROR_IS_FATAL ANY)
  file(REMOVE ${package})
  execute_process(COMMAND ar rcSD ${package} ${names} WORKING_DIRECTORY ${members} COMMAND_ERROR_IS_FATAL ANY)
  file(REMOVE_RECURSE ${members})
endforeach()
