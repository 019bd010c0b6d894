unit_test(confine test_network Threads::Threads)
