"""Publishers, subscriptions, serialised messages, domains, and Fast DDS's shared memory."""
