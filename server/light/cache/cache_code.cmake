# Writes OUT, a C source that defines cache_code (cache_file.h): SHA-256 of the files of the ROOMS below SERVER, and of FLAGS.
# cmake -DSERVER=... -DROOMS=a,b -DFLAGS=... -DOUT=... -P cache_code.cmake
string(REPLACE "," ";" ROOMS "${ROOMS}")
set(all "${FLAGS}")
foreach(room ${ROOMS})
  file(GLOB files RELATIVE "${SERVER}" "${SERVER}/${room}/*.c" "${SERVER}/${room}/*.h")
  list(SORT files)
  foreach(file ${files})
    file(SHA256 "${SERVER}/${file}" digest)
    string(APPEND all " ${file} ${digest}")
  endforeach()
endforeach()
string(SHA256 digest "${all}")
file(WRITE "${OUT}" "#include \"light/cache/cache_file.h\"\n\nconst char cache_code[] = \"${digest}\";\n")
